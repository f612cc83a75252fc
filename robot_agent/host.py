"""The robots of one process on the network, and the threads that keep them going."""

from __future__ import annotations

import threading
import time
import zlib
from collections.abc import Callable, Sequence

import msgspec

from robot_agent.agent import RobotAgent
from robot_agent.duty import Duty
from robot_agent.fit import Fit
from robot_agent.metrics import RobotMetrics
from robot_agent.pace import Pace
from robot_agent.thinning import Thinner
from swarm import keyspace
from swarm.areas import cell_of, name_of
from swarm.errors import CoAdaptError
from swarm.listening import hear
from swarm.log import Logger
from swarm.loop_watch import Loops, unwatched
from swarm.messages import Beacon, NetDemand, SceneDescription
from swarm.session import Session
from swarm.tcp.watch import TcpWatch
from swarm.traffic import TrafficClass

JOIN_S = 0.5
IDLE_S = 0.005
SHARE_WAIT_S = 0.5
"""The loop turns at least so often, also where nothing is sensed."""
MEASURE_S = 0.5
"""From one algorithm's measurement to the next one's: a robot's are spread over time."""


class RobotHost:
    """Runs robots on one session until closed. A loop's failure is counted, and it goes on."""

    def __init__(
        self,
        agents: Sequence[RobotAgent],
        session: Session,
        *,
        beacon_rate_hz: float,
        scene_rate_hz: float,
        measure_rate_hz: float,
        workers: int,
        areas: bool = False,
        metrics: RobotMetrics,
        log: Logger,
        fit: Fit,
        loops: Loops = unwatched,
    ) -> None:
        """`areas`: beacons and scenes say in their keys in which cell of the floor a robot is."""
        self._session = session
        self._metrics = metrics
        self._log = log
        self._loops = loops
        self._areas = areas
        self._stop = threading.Event()
        self._faults: set[tuple[str, str]] = set()
        self._duties: dict[str, Duty] = {}
        self._uplink = TcpWatch()
        self._thinners = {agent.robot: Thinner() for agent in agents}
        self._sensed = threading.Event()
        self._pace = Pace()
        self._fit = fit
        hear(session, {NetDemand: self._on_demand})
        self._threads = [self._thread("beacon", 1 / beacon_rate_hz, agents, self._beacon)]
        for part in (agents[i::workers] for i in range(min(workers, len(agents)))):
            self._threads.append(self._thread("scene", 1 / scene_rate_hz, part, self._scene))
            step_s = min(MEASURE_S, 1 / measure_rate_hz)
            self._threads.append(self._thread("measure", step_s, part, self._measure))
            self._threads.append(
                threading.Thread(target=self._sense, args=(part,), name="sense", daemon=True)
            )
        self._threads.append(
            threading.Thread(target=self._share, args=(agents,), name="share", daemon=True)
        )
        for thread in self._threads:
            thread.start()
        for agent in agents:
            self._duties[agent.robot] = Duty(agent, session, metrics, log, self._uplink.total)

    def close(self) -> None:
        """Stops the loops. Does not wait for one that is stuck in a scan."""
        self._stop.set()
        self._sensed.set()
        self._uplink.close()
        deadline = time.monotonic() + JOIN_S
        for thread in self._threads:
            thread.join(max(0.0, deadline - time.monotonic()))

    def _on_demand(self, demand: NetDemand) -> None:
        self._pace.on_demand(demand)
        self._fit.on_demand(demand)

    def _thread(
        self,
        name: str,
        period_s: float,
        agents: Sequence[RobotAgent],
        work: Callable[[RobotAgent], None],
    ) -> threading.Thread:
        turned = self._loops(name, period_s)

        def loop() -> None:
            # The robots of a machine start together, but need not work at the same moments.
            due = time.monotonic() + period_s * (zlib.crc32(agents[0].robot.encode()) % 64) / 64
            while not self._stop.wait(max(0.0, due - time.monotonic())):
                for agent in agents:
                    turned()
                    self._guarded(name, work, agent)
                # A late loop leaves turns out rather than catching up.
                due = max(due + period_s, time.monotonic())

        return threading.Thread(target=loop, name=name, daemon=True)

    def _sense(self, agents: Sequence[RobotAgent]) -> None:
        turned = self._loops("sense", 0.0)
        while not self._stop.is_set():
            for agent in agents:
                turned()
                self._guarded("sense", self._sense_one, agent)
            self._stop.wait(max(IDLE_S, min(a.sensor.next_frame_in_s() for a in agents)))

    def _sense_one(self, agent: RobotAgent) -> None:
        if agent.sensor.sense():
            self._sensed.set()

    def _share(self, agents: Sequence[RobotAgent]) -> None:
        """Publishes what several egos share of each new frame."""
        turned = self._loops("share", 0.0)
        while not self._stop.is_set():
            turned()
            if self._sensed.wait(SHARE_WAIT_S):
                self._sensed.clear()
                for agent in agents:
                    self._guarded("share", self._share_one, agent)

    def _share_one(self, agent: RobotAgent) -> None:
        swarm = self._session.swarm
        for observation in agent.share():
            told = msgspec.structs.replace(observation, uplink=self._uplink.total())
            key = keyspace.shared(swarm, agent.robot, observation.algorithm)
            self._session.put(key, told, TrafficClass.FUSION)

    def _beacon(self, agent: RobotAgent) -> None:
        thinner, now = self._thinners[agent.robot], time.monotonic()
        beacon = agent.beacon() if thinner.beacon_is_due(now) else None
        if beacon is not None:
            beacon = msgspec.structs.replace(beacon, echoes=self._pace.echoes(agent.robot))
            beacon = thinner.beacon(beacon, self._pace.control_bps(agent.robot), now)
            self._tell(keyspace.beacon, beacon)

    def _scene(self, agent: RobotAgent) -> None:
        thinner, now = self._thinners[agent.robot], time.monotonic()
        scene = agent.describe() if thinner.scene_is_due(now) else None
        if scene is not None:
            scene = thinner.scene(scene, self._pace.control_bps(agent.robot), now)
            self._tell(keyspace.scene, scene)

    def _tell(self, key: Callable[[str, str], str], told: Beacon | SceneDescription) -> None:
        where = key(self._session.swarm, told.robot)
        if self._areas:
            where = keyspace.within(where, name_of(cell_of(*told.pose[:2])))
        self._session.put(where, told)

    def _measure(self, agent: RobotAgent) -> None:
        self._fit.look()
        agent.measure()

    def _guarded(self, loop: str, work: Callable[[RobotAgent], object], agent: RobotAgent) -> None:
        duty = self._duties.get(agent.robot)
        if self._stop.is_set() or (duty is not None and not duty.on):
            return
        try:
            work(agent)
        except Exception as error:
            self._metrics.faults.labels(loop).inc()
            kind = (loop, type(error).__name__)
            if kind not in self._faults:
                self._faults.add(kind)
                known = isinstance(error, CoAdaptError)
                self._log.error(
                    "loop_fault",
                    loop=loop,
                    robot=agent.robot,
                    error=str(error)[:300],
                    exc_info=not known,
                )
