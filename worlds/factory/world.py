"""`FactoryWorld`: the simulated factory behind the interface of a world."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes
from swarm.body import Body
from swarm.errors import WorldError
from swarm.geometry import Pose
from worlds.base import GroundTruth, Rays, Scan, SelfDescribing
from worlds.cache import ScanCache
from worlds.factory.actors import ROBOT_BODY, SENSOR_HEIGHT_M, Solids, solids, true_boxes
from worlds.factory.layout import build_floor
from worlds.factory.lidar import RANGE_M, RINGS, Lidar
from worlds.factory.paths import Motion
from worlds.factory.scenarios import PERIOD_S, cast, check_scenario, link_rate_bps
from worlds.recent import Recent
from worlds.returns import Returns, kept_returns

RATE_HZ = 10.0
ROBOTS_ALLOWED = (2, 1000)
ROOM_ALLOWED = (1.0, 4.0)
GENERATOR, GENERATOR_UNCOMPILED = 4, 3
"""Versions of everything that shapes a scan, with rays cast in C and without, where points differ
in their last bits. Any change of a point takes a new number."""
MIN_KEPT = 64
"""Scans and truths held in memory; a large swarm holds one frame of all its robots."""


class FactoryWorld(SelfDescribing):
    """A factory floor with robots R1 to Rn.

    Every scan follows from (robots, seed, rings, scenario, room, robot, frame) alone: any process
    computes the same points, and no frame depends on an earlier one.
    """

    name = "factory"
    rate_hz = RATE_HZ
    frame_count = round(PERIOD_S * RATE_HZ)
    range_m = RANGE_M
    detector = "factory"

    def __init__(
        self,
        robots: int = 6,
        seed: int = 1,
        rings: int = 32,
        scenario: str = "floor",
        room: float = 1.0,
        cache: Path | None = None,
    ) -> None:
        """Lays out the floor; no scan is computed yet.

        Args:
            robots: 2 to 1000; the floor grows with them.
            seed: 0 or more; of the equipment, the traffic and the noise.
            rings: of the LiDAR: 16, 32 or 64.
            scenario: one of `worlds.factory.scenarios.SCENARIOS`.
            room: 1 to 4; how many times as large as usual the floor is.
            cache: directory in which scans are kept; None keeps none.

        Raises WorldError for a value that is not allowed.
        """
        low, high = ROBOTS_ALLOWED
        if not low <= robots <= high:
            raise WorldError(f"a factory cannot have {robots} robots; allowed: {low} to {high}")
        if rings not in RINGS:
            allowed = ", ".join(map(str, RINGS))
            raise WorldError(f"a LiDAR cannot have {rings} rings; allowed: {allowed}")
        if seed < 0:
            raise WorldError(f"seed {seed} cannot be used; allowed: 0 or more")
        smallest, largest = ROOM_ALLOWED
        if not smallest <= room <= largest:
            raise WorldError(f"room {room:g} cannot be used; allowed: {smallest:g} to {largest:g}")
        self.scenario = check_scenario(scenario)
        self.robots = tuple(f"R{i + 1}" for i in range(robots))
        rng = np.random.default_rng(seed)
        self.floor = build_floor(robots, rng, room)
        self._actors = cast(scenario, self.floor, robots, rng)
        self._lidar = Lidar(self.floor, rings)
        self._noise_key = (seed, zlib.crc32(scenario.encode()))
        version = GENERATOR if self._lidar.compiled else GENERATOR_UNCOMPILED
        self._file_key = f"v{version}-{scenario}-s{seed}-r{rings}-n{robots}"
        if room != 1.0:
            self._file_key += f"-room{room:g}"
        self._cache = ScanCache(cache) if cache is not None else None
        # A frame is a scan for each robot, the bodies and the truth.
        self._recent = Recent(max(MIN_KEPT, robots + 2))

    def pose(self, robot: str, frame: int) -> Pose:
        """The robot's sensor in the world frame. Raises WorldError for an unknown robot."""
        motion = self._motion(self._index(robot), frame)
        return Pose(motion.x, motion.y, SENSOR_HEIGHT_M, yaw=motion.heading)

    def body(self, robot: str) -> Body:
        """The carrier with its mast. Raises WorldError for an unknown robot."""
        self._index(robot)
        return ROBOT_BODY

    def rays(self) -> Rays:
        """Of every robot's sensor."""
        return self._lidar.rays

    def scan(self, robot: str, frame: int) -> Scan:
        """One scan: all rays at the frame's time. Raises WorldError for an unknown robot."""
        return self.scan_with_actors(robot, frame)[0]

    def scan_with_actors(self, robot: str, frame: int) -> tuple[Scan, NDArray[np.int16]]:
        """A scan and, for each point, the index of its actor in `ground_truth`, or -1."""
        frame %= self.frame_count
        index = self._index(robot)
        returns: Returns = self._recent.get(
            ("scan", index, frame), lambda: self._returns(index, frame)
        )
        scan = Scan(
            robot=robot,
            frame=frame,
            points=returns.points,
            pose=self.pose(robot, frame),
            velocity=self._motion(index, frame).velocity,
        )
        return scan, returns.actors

    def ground_truth(self, frame: int) -> GroundTruth:
        """The boxes of all robots, forklifts and workers. Computes the scans of all robots."""
        frame %= self.frame_count
        truth: GroundTruth = self._recent.get(("truth", 0, frame), lambda: self._truth(frame))
        return truth

    def actors(self, frame: int) -> tuple[Boxes, tuple[str, ...]]:
        """Boxes and names of all actors, seen or not, in the order of their indices."""
        boxes = true_boxes(self._actors, self._motions(frame))
        return boxes, tuple(actor.identity for actor in self._actors)

    def link_rate_bps(self, time_s: float) -> float | None:
        """The link's capacity at a time since the start of the scenario, or None: not given."""
        return link_rate_bps(self.scenario, time_s)

    def _index(self, robot: str) -> int:
        if robot not in self.robots:
            raise WorldError(
                f"robot {robot!r} is not in this factory; it has {self.robots[0]} to "
                f"{self.robots[-1]}"
            )
        return self.robots.index(robot)

    def _motion(self, index: int, frame: int) -> Motion:
        return self._actors[index].path.at(frame % self.frame_count / RATE_HZ)

    def _motions(self, frame: int) -> list[Motion]:
        return [self._motion(index, frame) for index in range(len(self._actors))]

    def _bodies(self, frame: int) -> Solids:
        """Kept because a process may host many robots."""
        bodies: Solids = self._recent.get(
            ("bodies", 0, frame), lambda: solids(self._actors, self._motions(frame))
        )
        return bodies

    def _returns(self, index: int, frame: int) -> Returns:
        name = f"{self._file_key}-{self.robots[index]}-{frame:04d}"

        def shoot() -> Returns:
            pose = self.pose(self.robots[index], frame)
            rng = np.random.default_rng((*self._noise_key, index, frame))
            return self._lidar.shoot(pose, index, self._bodies(frame), rng)

        return kept_returns(self._cache, name, shoot)

    def _truth(self, frame: int) -> GroundTruth:
        visible = np.zeros(len(self._actors), dtype=np.int64)
        for robot in self.robots:
            _, actors = self.scan_with_actors(robot, frame)
            visible += np.bincount(actors[actors >= 0], minlength=len(visible))
        boxes, names = self.actors(frame)
        return GroundTruth(boxes=boxes, ids=names, visible_points=visible)
