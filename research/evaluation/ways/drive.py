"""Frames of one drive that follow each other, fused in any way, each fusion once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from perception.codec.places import Places
from perception.fusion.base import Contribution, EncodeOptions, Fusion
from perception.fusion.known import KnownRobot
from perception.fusion.mixed import Mixed, scored_by
from perception.fusion.registry import make_fusion
from perception.memory.memory import View
from perception.memory.poses import PoseMemory
from perception.types import Boxes
from research.evaluation.splits import nearest_first
from research.evaluation.windows.announcements import Announced, heard
from research.evaluation.windows.frames import OnceWorld
from swarm.errors import PerceptionError
from swarm.geometry import Matrix
from worlds.base import World, comm_range_of
from worlds.cooperative.fusing import SINGLE, known_robots
from worlds.cooperative.pose_errors import PoseErrors, disturbed
from worlds.registry import open_world


@dataclass(frozen=True, slots=True)
class Focus:
    """What a robot is asked about that is not asked for everything."""

    places: Places = b""
    """Empty: for everything that may be an object."""
    without_outline: bool = False
    """As in `EncodeOptions`."""


OBJECTS = Focus()


NOWHERE: Mapping[str, Focus] = MappingProxyType({})
"""Nobody is asked about places only."""


@dataclass(frozen=True, slots=True)
class Drive:
    """Where and when."""

    world: str
    seed: int
    robots: int
    ego: int
    """Its number among the robots."""
    first: int
    frames: int
    kind: str = "floor"
    """Of the factory (worlds.factory.scenarios)."""
    rings: int = 32
    """Of the factory's LiDARs."""
    room: float = 1.0
    """Floor a robot of the factory, of what is usual."""
    folder: Path | None = None
    pose_noise_m: float = 0.0
    pose_errors: PoseErrors = "anew"
    pose_memory: bool = False
    """Whether the ego remembers by what poses are off."""

    def open(self) -> World:
        """The world; no scan is computed yet."""
        return open_world(
            self.world,
            data=self.folder,
            robots=self.robots,
            seed=self.seed,
            rings=self.rings,
            room=self.room,
            scenario=self.kind,
        )


@dataclass(frozen=True, slots=True, eq=False)
class FusedOnce:
    """What one fusion of one frame brought."""

    found: Boxes
    """With raw scores, in the world frame."""
    scored_as: str
    helpers: frozenset[str]
    bytes: Mapping[str, int]
    known: tuple[KnownRobot, ...]
    views: Mapping[str, View]
    world_from_own: Matrix
    focused: frozenset[str] = frozenset()
    """Helpers that told of places only; they have no view..."""
    objects_only: frozenset[str] = frozenset()
    """...nor have those that told only of what may be an object."""
    places: Places = b""
    """Which."""


class Driven:
    """A drive, frame by frame; what was fused once is kept."""

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        world = drive.open()
        self.world = OnceWorld(world)
        self.comm_range_m = comm_range_of(world)
        """How far from the ego a robot may take part."""
        self.ego = self.world.robots[drive.ego]
        self.frames = range(drive.first, drive.first + drive.frames)
        self.nearest = tuple(nearest_first(self.world, self.ego, drive.first))[1:]
        """The other robots as the drive begins."""
        self.seed = drive.seed
        self._fusions: dict[str, Fusion] = {}
        self._payloads: dict[
            tuple[int, str, str, float, Focus | None], tuple[Contribution, int]
        ] = {}
        self._heard: dict[tuple[int, tuple[str, ...]], Announced] = {}
        self._poses = PoseMemory()
        self._newest = -1
        self._fused: dict[tuple[object, ...], FusedOnce] = {}

    def fused(
        self,
        frame: int,
        asked: Mapping[str, str],
        max_error_m: float,
        places: Mapping[str, Focus] = NOWHERE,
    ) -> FusedOnce:
        """The frame with these robots, each in the form asked for; points within the error, of some
        robots only those that `places` says. Where the ego remembers poses, frames follow each
        other, and an earlier one begins anew."""
        if self.drive.pose_memory:
            if frame <= self._newest:
                self._poses = PoseMemory()
            self._newest = frame
            return self._fuse(frame, asked, max_error_m, places)
        key = (frame, tuple(sorted(asked.items())), max_error_m, tuple(sorted(places.items())))
        if key not in self._fused:
            self._fused[key] = self._fuse(frame, asked, max_error_m, places)
        return self._fused[key]

    def in_range(self, frame: int) -> list[str]:
        """The other robots that may take part then."""
        here = self.world.pose(self.ego, frame)
        return [
            robot
            for robot in self.nearest
            if self.world.pose(robot, frame).distance_to(here) <= self.comm_range_m
        ]

    def heard(self, frame: int, algorithms: Sequence[str]) -> Announced:
        """What the ego has heard by that frame; beacons tell sizes of those algorithms."""
        key = (frame, tuple(algorithms))
        if key not in self._heard:
            fusions = {name: self.fusion(name) for name in algorithms}
            noise_m = self.drive.pose_noise_m
            reach_m = self.comm_range_m + 10 * noise_m + 1.0
            self._heard[key] = heard(self.world, frame, self.ego, fusions, noise_m, reach_m)
        return self._heard[key]

    def knows_pose(self, robot: str, frame: int) -> bool:
        """Whether the ego, as it fused the frames until now, can do without the robot's outline."""
        return self.drive.pose_memory and self._poses.knows(robot, frame / self.world.rate_hz)

    def size(
        self, frame: int, robot: str, name: str, max_error_m: float, focus: Focus | None = None
    ) -> int:
        """Bytes that the robot sends, with those of asking for it; `focus`: what it is asked
        about, where not about everything."""
        return self._payload(frame, robot, name, max_error_m, focus)[1]

    def _payload(
        self, frame: int, robot: str, name: str, max_error_m: float, focus: Focus | None
    ) -> tuple[Contribution, int]:
        key = (frame, robot, name, max_error_m, focus)
        if key not in self._payloads:
            self._payloads[key] = self._encoded(*key)
        return self._payloads[key]

    def _fuse(
        self,
        frame: int,
        asked: Mapping[str, str],
        max_error_m: float,
        places: Mapping[str, Focus],
    ) -> FusedOnce:
        own = self.world.scan(self.ego, frame)
        forms = {name: self.fusion(name) for name in dict.fromkeys(asked.values())}
        here = own.pose.matrix()
        gathering = Mixed(forms or {"early": self.fusion("early")}).begin(own.points, here)
        now_s = frame / self.world.rate_hz
        if self.drive.pose_memory:
            gathering.remembered = self._poses.at(now_s, now_s, here)
        sizes: dict[str, int] = {}
        helpers: set[str] = set()
        for robot, name in asked.items():
            contribution, sizes[robot] = self._payload(
                frame, robot, name, max_error_m, places.get(robot)
            )
            try:
                gathering.add(contribution)
                helpers.add(robot)
            except PerceptionError:
                continue
        found = gathering.finish()
        helpers -= gathering.left_out().keys()
        noise = self.drive.pose_noise_m, self.drive.pose_errors, self.seed
        known = known_robots(self.world, frame, self.ego, *noise)
        focused = frozenset(robot for robot, one in places.items() if one.places) & helpers
        objects_only = (places.keys() - focused) & helpers
        sent = gathering.sent_points()
        whole = {robot: view for robot, view in sent.items() if robot not in places}
        views = {self.ego: (own.points, here), **whole}
        return FusedOnce(
            found,
            _scored_as([asked[robot] for robot in sorted(helpers)]),
            frozenset(helpers),
            sizes,
            self._poses.put_right(known, gathering.corrections(), now_s, here),
            views,
            here,
            focused,
            frozenset(objects_only),
            next((one.places for one in places.values() if one.places), b""),
        )

    def _encoded(
        self, frame: int, robot: str, name: str, max_error_m: float, focus: Focus | None
    ) -> tuple[Contribution, int]:
        """What the robot sends, and the bytes of that and of asking for it."""
        fusion, scan = self.fusion(name), self.world.scan(robot, frame)
        own, here = self.world.scan(self.ego, frame), self.world.pose(self.ego, frame)
        ask = fusion.begin(own.points, here.matrix()).ask()
        noise = self.drive.pose_noise_m, self.drive.pose_errors, self.seed
        pose = disturbed(scan.pose, robot, frame, *noise)
        if focus is not None:
            objects_only = not focus.places
            ask = replace(
                ask,
                demand=focus.places,
                without_outline=focus.without_outline,
                objects_only=objects_only,
            )
        options = EncodeOptions(
            max_error_m=max_error_m,
            pose=pose,
            reference=ask.reference,
            demand=ask.demand,
            without_outline=ask.without_outline,
            objects_only=ask.objects_only,
        )
        payload = fusion.encode(scan.points, options)
        sent = Contribution(robot, payload, pose.matrix(), form=name)
        return sent, len(payload) + ask.size()

    def fusion(self, name: str) -> Fusion:
        """An algorithm with the world's detector, made once."""
        if name not in self._fusions:
            self._fusions[name] = make_fusion(name, self.world.detector)
        return self._fusions[name]


def _scored_as(forms: list[str]) -> str:
    """Whose calibration holds."""
    return scored_by(forms) if forms else SINGLE
