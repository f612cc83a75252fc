"""Everything that the ego has heard of one robot."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from ego_agent.knowledge.model import RobotView
from ego_agent.monitor.clock_offset import ClockOffset
from ego_agent.monitor.identity import DUPLICATE_WINDOW_S, Numbers, Stream, twins
from swarm.fitting import other_world
from swarm.messages import Beacon, Observation, SceneDescription
from swarm.messages.base import Vector6

MAX_INSTANCES = 8
UNREADABLE_S = 1.0
"""A robot that is heard well meanwhile is not at fault for what cannot be read on its keys."""
SMOOTHING = 0.25
"""Weight of a new round trip in the smoothed one (RFC 6298 uses 1/8 for TCP's many samples)."""


class _Shown(NamedTuple):
    """What an answer tells of its robot, as a beacon does."""

    instance: int
    capture_ns: int
    frame: int
    pose: Vector6
    at: float


@dataclass(slots=True)
class RobotRecord:
    """One robot id. Times are seconds of the ego's steady clock."""

    alive: bool = False
    instance: int | None = None
    streams: dict[int, Stream] = field(default_factory=dict)
    conflict_at: float = float("-inf")
    heard_at: float = float("-inf")
    beacon: Beacon | None = None
    beacon_at: float = float("-inf")
    shown: _Shown | None = None
    """Its newest answer, which counts like a beacon: whoever sends frames need not say more."""
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

    def take_beacon(self, beacon: Beacon, now: float, echo: tuple[int, int] | None) -> bool:
        """Takes a beacon, and what it echoes of the ego's own messages; False where its number
        does not come next."""
        now_ns, known = nanoseconds(now), self.beacon
        stream = self._speaks(beacon.instance, now)
        if known is not None and twins(known, beacon):
            self.conflict_at = now
        if not self._in_order(stream.beacons, beacon.seq, now):
            return False
        if known is not None and known.instance == beacon.instance and not beacon.sizes:
            # A robot that speaks little leaves out sizes that it has told, and its body.
            body = beacon.body or known.body
            beacon = msgspec.structs.replace(beacon, sizes=known.sizes, body=body)
        if known is not None and known.instance == beacon.instance and not beacon.world:
            beacon = msgspec.structs.replace(beacon, world=known.world, software=known.software)
        self.beacon = beacon
        self.beacon_at = now
        steady_ns = beacon.steady_ns or beacon.sent_ns
        self.wall_ns = beacon.sent_ns - steady_ns
        self.offset.heard(steady_ns, now_ns)
        if echo is not None:
            self.offset.echoed(*echo, now_ns)
        self.delay_s = max(0.0, self._sensed_ago_s(beacon.sent_ns, now_ns))
        return True

    def take_scene(self, scene: SceneDescription, now: float) -> bool:
        """Takes a scene description; False where its number does not come next."""
        stream = self._speaks(scene.instance, now)
        if not self._in_order(stream.scenes, scene.seq, now):
            return False
        self.scene = scene
        self.scene_at = now
        return True

    def take_answer(self, seen: Observation, now: float) -> None:
        """Takes where an answer shows the robot, if the process that sends its beacons gave it."""
        if self.beacon is None or seen.instance != self.beacon.instance:
            return
        new = _Shown(seen.instance, seen.capture_ns, seen.frame, seen.pose, now)
        old = self.shown
        if old is None or self._age_s(new.capture_ns, new.at, now) <= self._age_s(
            old.capture_ns, old.at, now
        ):
            self.shown = new

    def told(self, now: float) -> tuple[Beacon, float] | None:
        """The newest beacon, and its age in seconds: with the frame of the newest answer, where
        that is younger. None before the first beacon."""
        beacon, shown = self.beacon, self.shown
        if beacon is None:
            return None
        age_s = self._age_s(beacon.capture_ns, self.beacon_at, now)
        if shown is None or shown.instance != beacon.instance:
            return beacon, age_s
        shown_s = self._age_s(shown.capture_ns, shown.at, now)
        if shown_s >= age_s:
            return beacon, age_s
        newer = msgspec.structs.replace(
            beacon,
            sent_ns=max(beacon.sent_ns, shown.capture_ns),
            capture_ns=shown.capture_ns,
            frame=shown.frame,
            pose=shown.pose,
        )
        return newer, shown_s

    def _age_s(self, capture_ns: int, came_at: float, now: float) -> float:
        """Of what was captured then on the robot's time of day, and is here since `came_at`."""
        return max(now - came_at, self._sensed_ago_s(capture_ns, nanoseconds(now)))

    def take_round_trip(self, seconds: float) -> None:
        """Takes the time from a query to its answer."""
        old = self.round_trip_s
        self.round_trip_s = seconds if old is None else old + SMOOTHING * (seconds - old)

    def is_duplicate(self, now: float) -> bool:
        """Whether two processes use the id."""
        return now - self.conflict_at <= DUPLICATE_WINDOW_S

    def clock_offset_ns(self, now_ns: int, wall_ns: int) -> int:
        """The robot's time of day minus the ego's, which is `wall_ns` at `now_ns` on its steady
        clock; 0 before the first beacon."""
        if self.beacon is None:
            return 0
        return self.offset.now(now_ns) + self.wall_ns - (wall_ns - now_ns)

    def view(
        self, robot: str, now: float, wall_ns: int, *, mark: str, capacity_bps: float
    ) -> RobotView:
        """What is known now. `mark`: of the ego's world; `capacity_bps`: of the robot's link."""
        scene, now_ns = self.scene, nanoseconds(now)
        scene_age_s = math.inf
        beacon, beacon_age_s = self.told(now) or (None, math.inf)
        if scene is not None:
            scene_age_s = now - self.scene_at
            if beacon is not None:
                scene_age_s = self._age_s(scene.capture_ns, self.scene_at, now)
        return RobotView(
            robot=robot,
            alive=self.alive,
            beacon=beacon,
            beacon_age_s=beacon_age_s,
            scene=scene,
            scene_age_s=scene_age_s,
            round_trip_s=self.round_trip_s,
            clock_offset_s=self.clock_offset_ns(now_ns, wall_ns) * 1e-9,
            duplicate=self.is_duplicate(now),
            capacity_bps=capacity_bps,
            delay_s=self.delay_s,
            unheard_s=now - self.beacon_at,
            misfit=self._misfit(mark),
        )

    def _sensed_ago_s(self, capture_ns: int, now_ns: int) -> float:
        """Since a capture on the robot's time of day, at `now_ns` on the ego's steady clock."""
        return (now_ns + self.offset.now(now_ns) + self.wall_ns - capture_ns) * 1e-9

    def _misfit(self, mark: str) -> str:
        """Why what the robot says is of no use here; empty where it fits."""
        if self.unreadable_at > self.beacon_at + UNREADABLE_S:
            return f"what it says cannot be read: {self.unreadable}"
        return other_world(mark, self.beacon.world) if self.beacon is not None else ""

    def _in_order(self, numbers: Numbers, seq: int, now: float) -> bool:
        """Whether a message's number comes next."""
        follows = numbers.follows(seq, now)
        if follows is None:
            self.conflict_at = now
        return bool(follows)

    def _speaks(self, instance: int, now: float) -> Stream:
        """Notes which process speaks.

        Another process than the last one is a restart (the old one stays silent) or a duplicate
        (the old one speaks again soon): heard in turn A, B, A within the window is a duplicate.
        """
        self.heard_at = now
        stream = self.streams.get(instance)
        if instance != self.instance:
            if stream is not None and now - stream.heard_at <= DUPLICATE_WINDOW_S:
                self.conflict_at = now
            self.instance = instance
            self.offset = ClockOffset()
        if stream is None:
            if len(self.streams) >= MAX_INSTANCES:
                oldest = min(self.streams, key=lambda known: self.streams[known].heard_at)
                del self.streams[oldest]
            stream = self.streams[instance] = Stream(heard_at=now)
        stream.heard_at = now
        return stream


def nanoseconds(seconds: float) -> int:
    """As an integer."""
    return round(seconds * 1e9)
