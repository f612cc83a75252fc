"""Monitor: what the ego knows of every robot and of the link, as of now.

Zenoh's threads feed it, the control cycle takes a `Snapshot`. Ages count from the moment of
receipt on the ego's monotonic clock, so that a robot's bad clock does not matter.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import msgspec

from ego_agent.link import LinkEstimate
from ego_agent.model import RobotView, Snapshot
from ego_agent.netstate import LinkWatch
from swarm import keyspace
from swarm.messages import Beacon, NetState, SceneDescription, TcpState
from swarm.process import Clock
from swarm.session import Session

MAX_ROBOTS = 256
MAX_INSTANCES = 8
DUPLICATE_WINDOW_S = 2.0
"""Two processes that are heard in turn within this time share an id."""
OFFSET_WINDOW = 64
"""Beacons over which the clock offset is taken: 6 s at 10 Hz."""
FORGET_S = 30.0
"""A robot that has left and was silent this long makes room for another."""
_SMOOTHING = 0.25
"""Weight of a new round trip in the smoothed one (RFC 6298 uses 1/8 for TCP's many samples)."""


@dataclass(slots=True)
class _Stream:
    """What came from one process (instance) of a robot."""

    heard_at: float
    beacon_seq: int = -1
    scene_seq: int = -1


@dataclass(slots=True)
class _Robot:
    """Everything known of one id."""

    alive: bool = False
    instance: int | None = None
    streams: dict[int, _Stream] = field(default_factory=dict)
    conflict_at: float = float("-inf")
    heard_at: float = float("-inf")
    beacon: Beacon | None = None
    beacon_at: float = 0.0
    scene: SceneDescription | None = None
    scene_at: float = 0.0
    delays_ns: deque[int] = field(default_factory=lambda: deque(maxlen=OFFSET_WINDOW))
    round_trip_s: float | None = None

    def offset_ns(self) -> int:
        """Robot's clock minus the ego's: the message that was fastest on its way counts."""
        return -min(self.delays_ns) if self.delays_ns else 0


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
    ) -> None:
        self.ego = ego
        self._link = link
        self._watch = LinkWatch(ego, link)
        self._clock = clock or Clock()
        self._monotonic = monotonic
        self._max_robots = max_robots
        self._lock = threading.Lock()
        self._robots: dict[str, _Robot] = {ego: _Robot(alive=True)}
        self._own: tuple[Beacon, float] | None = None
        self._own_scene: tuple[SceneDescription, float] | None = None
        self._out_of_order = 0
        self._no_room = 0

    def attach(self, session: Session) -> None:
        """Subscribes to everything that the monitor listens to."""
        swarm = session.swarm
        session.subscribe(
            keyspace.beacon(swarm, keyspace.ANY), Beacon, lambda m, _: self.on_beacon(m)
        )
        session.subscribe(
            keyspace.scene(swarm, keyspace.ANY), SceneDescription, lambda m, _: self.on_scene(m)
        )
        session.subscribe(keyspace.net_state(swarm), NetState, lambda m, _: self.on_net_state(m))
        session.subscribe(keyspace.net_tcp(swarm), TcpState, lambda m, _: self.on_tcp_state(m))
        session.watch_alive(self.on_join, self.on_leave)

    def on_beacon(self, beacon: Beacon) -> None:
        """Takes a robot's beacon."""
        now = self._monotonic()
        received_ns = self._clock.now_ns()
        with self._lock:
            robot = self._heard(beacon.robot, beacon.instance, now)
            if robot is None:
                return
            stream = robot.streams[beacon.instance]
            if beacon.seq <= stream.beacon_seq:
                self._out_of_order += 1
                return
            stream.beacon_seq = beacon.seq
            robot.beacon = beacon
            robot.beacon_at = now
            robot.delays_ns.append(received_ns - beacon.sent_ns)

    def on_scene(self, scene: SceneDescription) -> None:
        """Takes a robot's scene description."""
        now = self._monotonic()
        with self._lock:
            robot = self._heard(scene.robot, scene.instance, now)
            if robot is None:
                return
            stream = robot.streams[scene.instance]
            if scene.seq <= stream.scene_seq:
                self._out_of_order += 1
                return
            stream.scene_seq = scene.seq
            robot.scene = scene
            robot.scene_at = now

    def note_own(self, beacon: Beacon, scene: SceneDescription | None = None) -> None:
        """Takes what the ego senses itself; it counts before anything heard under its own id."""
        now = self._monotonic()
        with self._lock:
            self._own = (beacon, now)
            if scene is not None:
                self._own_scene = (scene, now)

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
            heard = (entry.heard_at for entry in self._robots.values())
            return self._monotonic() - max(heard, default=-math.inf)

    def on_join(self, robot: str) -> None:
        """A liveliness token appeared."""
        with self._lock:
            entry = self._entry(robot, self._monotonic())
            if entry is not None:
                entry.alive = True

    def on_leave(self, robot: str) -> None:
        """A liveliness token is gone. Whether the ego is alive, it knows better itself."""
        with self._lock:
            if robot in self._robots and robot != self.ego:
                self._robots[robot].alive = False

    def note_round_trip(self, robot: str, seconds: float) -> None:
        """Takes the time from a query to its answer."""
        with self._lock:
            entry = self._robots.get(robot)
            if entry is not None:
                old = entry.round_trip_s
                entry.round_trip_s = seconds if old is None else old + _SMOOTHING * (seconds - old)

    def is_alive(self, robot: str) -> bool:
        """The robot's liveliness token is present."""
        with self._lock:
            return robot in self._robots and self._robots[robot].alive

    def clock_offset_ns(self, robot: str) -> int:
        """The robot's clock minus the ego's, less the shortest one-way delay; 0 if unknown."""
        with self._lock:
            entry = self._robots.get(robot)
            return entry.offset_ns() if entry is not None else 0

    def counts(self) -> MonitorCounts:
        """Messages that were valid but not taken."""
        with self._lock:
            return MonitorCounts(out_of_order=self._out_of_order, no_room=self._no_room)

    def snapshot(self, cycle: int, now_ns: int) -> Snapshot:
        """What is known now; the ego is one of the robots, alive as long as it can ask."""
        now = self._monotonic()
        capacity_bps, source = self._link.capacity(now)
        limits = self._link.robot_limits(now)
        error = self._link.error_ratio(now)
        with self._lock:
            views = {
                robot: self._view(robot, entry, now, limits.get(robot, math.inf))
                for robot, entry in self._robots.items()
            }
            views[self.ego] = self._own_view(now)
        return Snapshot(
            ego=self.ego,
            cycle=cycle,
            now_ns=now_ns,
            robots=views,
            capacity_bps=capacity_bps,
            capacity_source=source,
            capacity_error=error,
        )

    def _view(self, robot: str, entry: _Robot, now: float, capacity_bps: float) -> RobotView:
        return RobotView(
            robot=robot,
            alive=entry.alive,
            beacon=entry.beacon,
            beacon_age_s=now - entry.beacon_at if entry.beacon else float("inf"),
            scene=entry.scene,
            scene_age_s=now - entry.scene_at if entry.scene else float("inf"),
            round_trip_s=entry.round_trip_s,
            clock_offset_s=entry.offset_ns() * 1e-9,
            duplicate=now - entry.conflict_at <= DUPLICATE_WINDOW_S,
            capacity_bps=capacity_bps,
        )

    def _own_view(self, now: float) -> RobotView:
        """The ego as it senses itself. An impostor under its id cannot harm it: nothing of what
        the ego knows about itself comes over the link but what its own payloads would cost."""
        heard = self._robots[self.ego].beacon
        beacon, beacon_at = self._own or (None, float("-inf"))
        scene, scene_at = self._own_scene or (None, float("-inf"))
        if beacon is not None and heard is not None:
            beacon = msgspec.structs.replace(beacon, sizes=heard.sizes)
        return RobotView(
            robot=self.ego,
            alive=True,
            beacon=beacon,
            beacon_age_s=now - beacon_at,
            scene=scene,
            scene_age_s=now - scene_at,
            round_trip_s=0.0,
            clock_offset_s=0.0,
            duplicate=False,
        )

    def _entry(self, robot: str, now: float) -> _Robot | None:
        """The robot's entry, new if there is room. Call with the lock held."""
        entry = self._robots.get(robot)
        if entry is None:
            if len(self._robots) >= self._max_robots:
                self._forget(now)
            if len(self._robots) >= self._max_robots:
                self._no_room += 1
                return None
            entry = self._robots[robot] = _Robot()
        return entry

    def _forget(self, now: float) -> None:
        """Drops the robots that have left and are silent."""
        for robot in [
            robot
            for robot, entry in self._robots.items()
            if not entry.alive and now - entry.heard_at > FORGET_S
        ]:
            del self._robots[robot]

    def _heard(self, robot: str, instance: int, now: float) -> _Robot | None:
        """The robot's entry after noting which process spoke. Call with the lock held.

        Another process than the last one is a restart (the old one stays silent) or a duplicate
        (the old one speaks again soon): heard in turn A, B, A within the window is a duplicate.
        """
        entry = self._entry(robot, now)
        if entry is None:
            return None
        entry.heard_at = now
        stream = entry.streams.get(instance)
        if instance != entry.instance:
            if stream is not None and now - stream.heard_at <= DUPLICATE_WINDOW_S:
                entry.conflict_at = now
            entry.instance = instance
            entry.delays_ns.clear()
        if stream is None:
            if len(entry.streams) >= MAX_INSTANCES:
                oldest = min(entry.streams, key=lambda known: entry.streams[known].heard_at)
                del entry.streams[oldest]
            stream = entry.streams[instance] = _Stream(heard_at=now)
        stream.heard_at = now
        return entry
