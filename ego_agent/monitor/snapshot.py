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
from dataclasses import dataclass, field

import msgspec

from ego_agent.knowledge.model import RobotView, Snapshot
from ego_agent.monitor.clock_offset import ClockOffset
from ego_agent.monitor.identity import DUPLICATE_WINDOW_S, Numbers, Stream, twins
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.netstate import LinkWatch
from ego_agent.monitor.surroundings import Surroundings
from swarm import keyspace
from swarm.errors import CoAdaptError, KeyspaceError
from swarm.fitting import other_world
from swarm.listening import Handlers, hear
from swarm.messages import Beacon, NetState, SceneDescription, TcpState
from swarm.process import Clock
from swarm.session import Session

MAX_ROBOTS = 1024
"""Of which the newest messages are kept: several times what is ever in range. Names come from the
network, and one that is made up takes as much memory as the largest scene that a router passes."""
MAX_INSTANCES = 8
MAX_TOKENS = 100_000
"""Of robots that have no beacon: names cost little, a robot's entry more."""
MAX_STAMPS = 256
"""The ego's own messages that a robot may still echo."""
UNREADABLE_S = 1.0
"""A robot that is heard well meanwhile is not at fault for what cannot be read on its keys."""
FORGET_S = 30.0
"""A robot that has left and was silent this long makes room for another."""
_SMOOTHING = 0.25
"""Weight of a new round trip in the smoothed one (RFC 6298 uses 1/8 for TCP's many samples)."""


@dataclass(slots=True)
class _Robot:
    """Everything known of one id."""

    alive: bool = False
    instance: int | None = None
    streams: dict[int, Stream] = field(default_factory=dict)
    conflict_at: float = float("-inf")
    heard_at: float = float("-inf")
    beacon: Beacon | None = None
    beacon_at: float = float("-inf")
    scene: SceneDescription | None = None
    scene_at: float = 0.0
    offset: ClockOffset = field(default_factory=ClockOffset)
    wall_ns: int = 0
    """Its time of day minus its steady clock."""
    delay_s: float = 0.0
    """How long the newest beacon was on its way."""
    round_trip_s: float | None = None
    unreadable: str = ""
    """Why its last beacon or scene that could not be read could not."""
    unreadable_at: float = float("-inf")

    def sensed_ago_s(self, capture_ns: int, now_ns: int) -> float:
        """Since a capture on the robot's time of day, at `now_ns` on the ego's steady clock."""
        return (now_ns + self.offset.now(now_ns) + self.wall_ns - capture_ns) * 1e-9


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
        self._watch = LinkWatch(ego, link)
        self._clock = clock or Clock()
        self._monotonic = monotonic
        self._max_robots = max_robots
        self._surroundings = surroundings
        self._lock = threading.Lock()
        self._robots: dict[str, _Robot] = {ego: _Robot(alive=True)}
        self._tokens: set[str] = set()
        """Robots whose liveliness token is there."""
        self._own: tuple[Beacon, float] | None = None
        self._own_off_duty = ""
        self._own_scene: tuple[SceneDescription, float] | None = None
        self._stamps: deque[int] = deque(maxlen=MAX_STAMPS)
        self._out_of_order = 0
        self._no_room = 0

    def stamp(self) -> int:
        """The ego's steady clock, nanoseconds, for a message that robots echo."""
        now_ns = _ns(self._monotonic())
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
        now_ns = _ns(now)
        with self._lock:
            robot = self._heard(beacon.robot, beacon.instance, now)
            if robot is None:
                return
            known = robot.beacon
            if known is not None and twins(known, beacon):
                robot.conflict_at = now
            if not self._in_order(robot, robot.streams[beacon.instance].beacons, beacon.seq, now):
                return
            if known is not None and known.instance == beacon.instance and not beacon.sizes:
                # A robot that speaks little leaves out sizes that it has told.
                beacon = msgspec.structs.replace(beacon, sizes=known.sizes)
            if known is not None and known.instance == beacon.instance and not beacon.world:
                beacon = msgspec.structs.replace(beacon, world=known.world, software=known.software)
            robot.beacon = beacon
            robot.beacon_at = now
            steady_ns = beacon.steady_ns or beacon.sent_ns
            robot.wall_ns = beacon.sent_ns - steady_ns
            robot.offset.heard(steady_ns, now_ns)
            echo = beacon.echoes.get(self.ego)
            if echo is not None and echo[0] in self._stamps:
                robot.offset.echoed(*echo, now_ns)
            robot.delay_s = max(0.0, robot.sensed_ago_s(beacon.sent_ns, now_ns))

    def on_invalid(self, key: str, error: CoAdaptError) -> None:
        """Takes that a message could not be read; of robots that are known only."""
        now = self._monotonic()
        with suppress(KeyspaceError), self._lock:
            entry = self._robots.get(keyspace.robot_of(key))
            if entry is not None:
                entry.unreadable, entry.unreadable_at = str(error), now

    def on_scene(self, scene: SceneDescription) -> None:
        """Takes a robot's scene description."""
        now = self._monotonic()
        with self._lock:
            robot = self._heard(scene.robot, scene.instance, now)
            if robot is None:
                return
            if not self._in_order(robot, robot.streams[scene.instance].scenes, scene.seq, now):
                return
            robot.scene = scene
            robot.scene_at = now

    def note_own(self, beacon: Beacon, scene: SceneDescription | None = None) -> None:
        """Takes what the ego senses itself; it counts before anything heard under its own id."""
        now = self._monotonic()
        with self._lock:
            self._own = (beacon, now)
            if scene is not None:
                self._own_scene = (scene, now)
        if self._surroundings is not None:
            self._surroundings.moved(*beacon.pose[:2])

    def note_own_duty(self, off_duty_by: str) -> None:
        """Takes who keeps the ego's own robot out of the swarm; empty: nobody does."""
        with self._lock:
            self._own_off_duty = off_duty_by

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
            if len(self._tokens) < MAX_TOKENS:
                self._tokens.add(robot)
            if self._surroundings is not None and robot not in self._robots:
                return  # It is somewhere on the site, and shows itself where it comes near.
            entry = self._entry(robot, self._monotonic())
            if entry is not None:
                entry.alive = True

    def on_leave(self, robot: str) -> None:
        """A liveliness token is gone. Whether the ego is alive, it knows better itself."""
        with self._lock:
            self._tokens.discard(robot)
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

    def instance(self, robot: str) -> int | None:
        """Which process sends the robot's beacons; None before the first."""
        with self._lock:
            entry = self._robots.get(robot)
            return None if entry is None or entry.beacon is None else entry.beacon.instance

    def clock_offset_ns(self, robot: str) -> int:
        """The robot's time of day minus the ego's; 0 if unknown."""
        now_ns, wall_ns = _ns(self._monotonic()), self._clock.now_ns()
        with self._lock:
            entry = self._robots.get(robot)
            return _offset_ns(entry, now_ns, wall_ns) if entry is not None else 0

    def beacons(self) -> list[tuple[Beacon, int]]:
        """The newest beacon of every robot but the ego, and how far its time of day is ahead of
        the ego's, nanoseconds; of none whose id two processes use."""
        now = self._monotonic()
        now_ns, wall_ns = _ns(now), self._clock.now_ns()
        with self._lock:
            return [
                (entry.beacon, _offset_ns(entry, now_ns, wall_ns))
                for robot, entry in self._robots.items()
                if robot != self.ego
                and entry.beacon is not None
                and now - entry.conflict_at > DUPLICATE_WINDOW_S
            ]

    def counts(self) -> MonitorCounts:
        """Messages that were valid but not taken."""
        with self._lock:
            return MonitorCounts(out_of_order=self._out_of_order, no_room=self._no_room)

    def snapshot(self, cycle: int, now_ns: int) -> Snapshot:
        """What is known now; the ego is one of the robots, alive as long as it can ask."""
        now, wall_ns = self._monotonic(), self._clock.now_ns()
        capacity_bps, source = self.link.capacity(now)
        limits = self.link.robot_limits(now)
        error = self.link.error_ratio(now)
        with self._lock:
            if self._surroundings is not None:
                self._forget(now)
            views = {
                robot: self._view(robot, entry, now, wall_ns, limits.get(robot, math.inf))
                for robot, entry in self._robots.items()
            }
            views[self.ego] = self._own_view(now, wall_ns)
        return Snapshot(
            ego=self.ego,
            cycle=cycle,
            now_ns=now_ns,
            robots=views,
            capacity_bps=capacity_bps,
            capacity_source=source,
            capacity_error=error,
        )

    def _view(
        self, robot: str, entry: _Robot, now: float, wall_ns: int, capacity_bps: float
    ) -> RobotView:
        beacon, scene, now_ns = entry.beacon, entry.scene, _ns(now)
        beacon_age_s = scene_age_s = math.inf
        if beacon is not None:
            sensed_s = entry.sensed_ago_s(beacon.capture_ns, now_ns)
            beacon_age_s = max(now - entry.beacon_at, sensed_s)
        if scene is not None:
            scene_age_s = now - entry.scene_at
            if beacon is not None:
                scene_age_s = max(scene_age_s, entry.sensed_ago_s(scene.capture_ns, now_ns))
        return RobotView(
            robot=robot,
            alive=entry.alive,
            beacon=beacon,
            beacon_age_s=beacon_age_s,
            scene=scene,
            scene_age_s=scene_age_s,
            round_trip_s=entry.round_trip_s,
            clock_offset_s=_offset_ns(entry, now_ns, wall_ns) * 1e-9,
            duplicate=now - entry.conflict_at <= DUPLICATE_WINDOW_S,
            capacity_bps=capacity_bps,
            delay_s=entry.delay_s,
            misfit=self._misfit(entry),
        )

    def _misfit(self, entry: _Robot) -> str:
        """Why what a robot says is of no use here; empty where it fits."""
        if entry.unreadable_at > entry.beacon_at + UNREADABLE_S:
            return f"what it says cannot be read: {entry.unreadable}"
        return other_world(self.mark, entry.beacon.world) if entry.beacon is not None else ""

    def _own_view(self, now: float, wall_ns: int) -> RobotView:
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
            beacon_age_s=_own_age_s(beacon, now - beacon_at, wall_ns),
            scene=scene,
            scene_age_s=_own_age_s(scene, now - scene_at, wall_ns),
            round_trip_s=0.0,
            clock_offset_s=0.0,
            duplicate=False,
            off_duty=self._own_off_duty,
        )

    def _in_order(self, robot: _Robot, numbers: Numbers, seq: int, now: float) -> bool:
        """Whether a message's number comes next. Call with the lock held."""
        follows = numbers.follows(seq, now)
        if follows is None:
            robot.conflict_at = now
        if not follows:
            self._out_of_order += 1
        return bool(follows)

    def _entry(self, robot: str, now: float, *, speaks: bool = False) -> _Robot | None:
        """The robot's entry, new if there is room. A robot that `speaks` and whose token is there
        takes the room of one of which either is missing. Call with the lock held."""
        entry = self._robots.get(robot)
        if entry is None:
            if len(self._robots) >= self._max_robots:
                self._forget(now)
            if len(self._robots) >= self._max_robots and speaks and robot in self._tokens:
                self._displace()
            if len(self._robots) >= self._max_robots:
                self._no_room += 1
                return None
            entry = self._robots[robot] = _Robot(alive=robot in self._tokens)
        return entry

    def _displace(self) -> None:
        """Drops a robot that has never spoken, or whose token is not there, if there is one."""
        doubtful = (
            robot
            for robot, entry in self._robots.items()
            if robot != self.ego and (entry.heard_at == -math.inf or not entry.alive)
        )
        loser = next(doubtful, None)
        if loser is not None:
            del self._robots[loser]

    def _forget(self, now: float) -> None:
        """Drops the robots that have left and are silent; where only the surroundings are listened
        to, also those that are silent: they are somewhere else."""
        for robot in [
            robot
            for robot, entry in self._robots.items()
            if robot != self.ego
            and (self._surroundings is not None or not entry.alive)
            and now - entry.heard_at > FORGET_S
        ]:
            del self._robots[robot]

    def _heard(self, robot: str, instance: int, now: float) -> _Robot | None:
        """The robot's entry after noting which process spoke. Call with the lock held.

        Another process than the last one is a restart (the old one stays silent) or a duplicate
        (the old one speaks again soon): heard in turn A, B, A within the window is a duplicate.
        """
        entry = self._entry(robot, now, speaks=True)
        if entry is None:
            return None
        entry.heard_at = now
        stream = entry.streams.get(instance)
        if instance != entry.instance:
            if stream is not None and now - stream.heard_at <= DUPLICATE_WINDOW_S:
                entry.conflict_at = now
            entry.instance = instance
            entry.offset = ClockOffset()
        if stream is None:
            if len(entry.streams) >= MAX_INSTANCES:
                oldest = min(entry.streams, key=lambda known: entry.streams[known].heard_at)
                del entry.streams[oldest]
            stream = entry.streams[instance] = Stream(heard_at=now)
        stream.heard_at = now
        return entry


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def _offset_ns(entry: _Robot, now_ns: int, wall_ns: int) -> int:
    """The robot's time of day minus the ego's, which is `wall_ns` at `now_ns` on its steady clock;
    0 before the first beacon."""
    if entry.beacon is None:
        return 0
    return entry.offset.now(now_ns) + entry.wall_ns - (wall_ns - now_ns)


def _own_age_s(sensed: Beacon | SceneDescription | None, told_ago_s: float, wall_ns: int) -> float:
    """Of what the ego sensed itself; infinite where there is nothing."""
    if sensed is None:
        return math.inf
    return max(told_ago_s, (wall_ns - sensed.capture_ns) * 1e-9)
