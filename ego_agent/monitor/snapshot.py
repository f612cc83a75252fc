"""Monitor: what the ego knows of every robot and of the link, as of now.

Zenoh's threads feed it, the control cycle takes a `Snapshot`. Ages are ages of what was sensed:
they count from the capture, which the robot's clock tells and `ClockOffset` brings to the ego's.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from ego_agent.knowledge.model import Snapshot
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.netstate import LinkWatch
from ego_agent.monitor.own_senses import OwnSenses
from ego_agent.monitor.robot_record import nanoseconds
from ego_agent.monitor.robot_table import MAX_ROBOTS, RobotTable
from ego_agent.monitor.surroundings import Surroundings
from swarm import keyspace
from swarm.errors import CoAdaptError, KeyspaceError
from swarm.listening import Handlers, hear
from swarm.messages import Beacon, NetState, Observation, SceneDescription, TcpState
from swarm.process import Clock
from swarm.session import Session

MAX_STAMPS = 256
"""The ego's own messages that a robot may still echo."""


@dataclass(frozen=True, slots=True)
class MonitorCounts:
    """Messages that were valid but not taken, since the start."""

    out_of_order: int
    no_room: int


class Monitor:
    """Thread-safe store of what was heard. `monotonic` and `clock` may be set for tests."""

    def __init__(
        self,
        ego: str,
        link: LinkEstimate,
        *,
        clock: Clock | None = None,
        monotonic: Callable[[], float] = time.monotonic,
        max_robots: int = MAX_ROBOTS,
        surroundings: Surroundings | None = None,
        mark: str = "",
    ) -> None:
        """`surroundings`: what to listen to; None: to everybody, wherever they are. `mark`: of the
        ego's world (`sensing.mark`); empty compares it with nobody's."""
        self.ego = ego
        self.mark = mark
        self.link = link
        self._clock = clock or Clock()
        self._monotonic = monotonic
        self._surroundings = surroundings
        self._lock = threading.Lock()
        self._robots = RobotTable(ego, max_robots, nearby=surroundings is not None)
        self._watch = LinkWatch(ego, link, robots=self._robots.alive)
        self._own = OwnSenses()
        self._stamps: deque[int] = deque(maxlen=MAX_STAMPS)
        self._out_of_order = 0

    def stamp(self) -> int:
        """The ego's steady clock, nanoseconds, for a message that robots echo."""
        now_ns = nanoseconds(self._monotonic())
        with self._lock:
            self._stamps.append(now_ns)
        return now_ns

    def attach(self, session: Session) -> None:
        """Subscribes to everything that the monitor listens to; `close` ends following the ego."""
        robots: Handlers = {Beacon: self.on_beacon, SceneDescription: self.on_scene}
        if self._surroundings is None:
            hear(session, robots, on_invalid=self.on_invalid)
        else:
            self._surroundings.attach(session, robots, self.on_invalid)
        net: Handlers = {NetState: self.on_net_state, TcpState: self.on_tcp_state}
        hear(session, net, on_invalid=self.on_invalid)
        session.watch_alive(self.on_join, self.on_leave)

    def close(self) -> None:
        """Listens to nothing new any more."""
        if self._surroundings is not None:
            self._surroundings.close()

    def on_beacon(self, beacon: Beacon) -> None:
        """Takes a robot's beacon."""
        now = self._monotonic()
        with self._lock:
            record = self._robots.speaks(beacon.robot, now)
            if record is None:
                return
            echo = beacon.echoes.get(self.ego)
            if echo is not None and echo[0] not in self._stamps:
                echo = None
            if not record.take_beacon(beacon, now, echo):
                self._out_of_order += 1

    def on_invalid(self, key: str, error: CoAdaptError) -> None:
        """Takes that a message could not be read; of robots that are known only."""
        now = self._monotonic()
        with suppress(KeyspaceError), self._lock:
            record = self._robots.known.get(keyspace.robot_of(key))
            if record is not None:
                record.unreadable, record.unreadable_at = str(error), now

    def on_scene(self, scene: SceneDescription) -> None:
        """Takes a robot's scene description."""
        now = self._monotonic()
        with self._lock:
            record = self._robots.speaks(scene.robot, now)
            if record is not None and not record.take_scene(scene, now):
                self._out_of_order += 1

    def note_own(self, beacon: Beacon, scene: SceneDescription | None = None) -> None:
        """Takes what the ego senses itself; it counts before anything heard under its own id."""
        now = self._monotonic()
        with self._lock:
            self._own.take(beacon, scene, now)
        if self._surroundings is not None:
            self._surroundings.moved(*beacon.pose[:2])

    def note_own_duty(self, off_duty_by: str) -> None:
        """Takes who keeps the ego's own robot out of the swarm; empty: nobody does."""
        with self._lock:
            self._own.off_duty = off_duty_by

    def on_net_state(self, state: NetState) -> None:
        """Takes a network controller's word on the links."""
        with self._lock:
            if not self._watch.take(state, self._monotonic()):
                self._out_of_order += 1

    def on_tcp_state(self, state: TcpState) -> None:
        """Takes a router's word on its connections."""
        with self._lock:
            if not self._watch.take_tcp(state, self._monotonic()):
                self._out_of_order += 1

    def silent_s(self) -> float:
        """For how long no robot has been heard; infinite where none ever was."""
        with self._lock:
            heard = (record.heard_at for record in self._robots.known.values())
            return self._monotonic() - max(heard, default=-math.inf)

    def on_join(self, robot: str) -> None:
        """A liveliness token appeared."""
        with self._lock:
            self._robots.join(robot, self._monotonic())

    def on_leave(self, robot: str) -> None:
        """A liveliness token is gone."""
        with self._lock:
            self._robots.leave(robot)

    def note_answer(self, seen: Observation) -> None:
        """Takes what an answer tells of its robot: where it was, and when."""
        now = self._monotonic()
        with self._lock:
            record = self._robots.known.get(seen.robot)
            if record is not None:
                record.take_answer(seen, now)

    def note_round_trip(self, robot: str, seconds: float) -> None:
        """Takes the time from a query to its answer."""
        with self._lock:
            record = self._robots.known.get(robot)
            if record is not None:
                record.take_round_trip(seconds)

    def is_alive(self, robot: str) -> bool:
        """The robot's liveliness token is present."""
        with self._lock:
            record = self._robots.known.get(robot)
            return record is not None and record.alive

    def instance(self, robot: str) -> int | None:
        """Which process sends the robot's beacons; None before the first."""
        with self._lock:
            record = self._robots.known.get(robot)
            return None if record is None or record.beacon is None else record.beacon.instance

    def clock_offset_ns(self, robot: str) -> int:
        """The robot's time of day minus the ego's; 0 if unknown."""
        now_ns, wall_ns = nanoseconds(self._monotonic()), self._clock.now_ns()
        with self._lock:
            record = self._robots.known.get(robot)
            return 0 if record is None else record.clock_offset_ns(now_ns, wall_ns)

    def beacons(self) -> list[tuple[Beacon, int]]:
        """The newest beacon of every robot but the ego, with the frame of a newer answer, and how
        far its time of day is ahead of the ego's, nanoseconds; of none whose id two processes
        use."""
        now = self._monotonic()
        now_ns, wall_ns = nanoseconds(now), self._clock.now_ns()
        with self._lock:
            return [
                (told[0], record.clock_offset_ns(now_ns, wall_ns))
                for robot, record in self._robots.known.items()
                if robot != self.ego and not record.is_duplicate(now)
                if (told := record.told(now)) is not None
            ]

    def counts(self) -> MonitorCounts:
        """Messages that were valid but not taken."""
        with self._lock:
            return MonitorCounts(out_of_order=self._out_of_order, no_room=self._robots.no_room)

    def snapshot(self, cycle: int, now_ns: int) -> Snapshot:
        """What is known now; the ego is one of the robots, alive as long as it can ask."""
        now, wall_ns = self._monotonic(), self._clock.now_ns()
        capacity_bps, source = self.link.capacity(now)
        limits = self.link.robot_limits(now)
        error = self.link.error_ratio(now)
        with self._lock:
            if self._surroundings is not None:
                self._robots.forget(now)
            views = {
                robot: record.view(
                    robot,
                    now,
                    wall_ns,
                    mark=self.mark,
                    capacity_bps=limits.get(robot, math.inf),
                )
                for robot, record in self._robots.known.items()
            }
            heard = self._robots.known[self.ego].beacon
            views[self.ego] = self._own.view(self.ego, heard, now, wall_ns)
        return Snapshot(
            ego=self.ego,
            cycle=cycle,
            now_ns=now_ns,
            robots=views,
            capacity_bps=capacity_bps,
            capacity_source=source,
            capacity_error=error,
        )
