"""`RoadWorld`: a simulated street scene behind the interface of a world."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes
from swarm.body import Body
from swarm.errors import WorldError
from swarm.geometry import Pose, wrap_heading
from worlds.base import GroundTruth, Scan, SelfDescribing
from worlds.cache import ScanCache
from worlds.recent import Recent
from worlds.returns import Returns, kept_returns
from worlds.road.lidar import RANGE_M, Scene
from worlds.road.meshes import Mesh, join
from worlds.road.streets import plan_street
from worlds.road.surroundings import surroundings
from worlds.road.traffic import FRAMES, RATE_HZ, make_traffic

ROBOTS_ALLOWED = (1, 50)
SENSOR = (-0.5, 0.0, 1.93)
"""Of the LiDAR in the recording car's frame, as measured in OPV2V."""
LABEL = "vehicle"
GENERATOR = 2
"""Version of everything that shapes a scan: raise it when any point changes."""
MIN_KEPT = 16
"""Scans, scenes and truths held in memory."""


class RoadWorld(SelfDescribing):
    """A street with recording cars R1 to Rn, other traffic and parked vehicles.

    Every seed is another scene. Every scan follows from (seed, robots, robot, frame) alone. As in
    OPV2V a scan shows the bonnet and the boot of the car that carries the sensor.
    """

    name = "road"
    rate_hz = RATE_HZ
    frame_count = FRAMES
    range_m = RANGE_M
    detector = "road"

    def __init__(self, robots: int = 2, seed: int = 1, cache: Path | None = None) -> None:
        """Plans the street and its traffic; no scan is computed yet.

        Args:
            robots: 1 to 50; with many, they spread along the road.
            seed: 0 or more; of everything random.
            cache: directory in which scans are kept; None keeps none.

        Raises WorldError for a value that is not allowed, or when the robots find no room.
        """
        low, high = ROBOTS_ALLOWED
        if not low <= robots <= high:
            raise WorldError(f"a road cannot have {robots} robots; allowed: {low} to {high}")
        if seed < 0:
            raise WorldError(f"seed {seed} cannot be used; allowed: 0 or more")
        self.robots = tuple(f"R{i + 1}" for i in range(robots))
        self._seed = seed
        self._street = plan_street(np.random.default_rng((seed, 0)))
        self._actors = make_traffic(self._street, robots, np.random.default_rng((seed, 1, robots)))
        self._file_key = f"road-v{GENERATOR}-s{seed}-n{robots}"
        self._cache = ScanCache(cache) if cache is not None else None
        self._recent = Recent(max(MIN_KEPT, robots + 2))

    def pose(self, robot: str, frame: int) -> Pose:
        """The robot's sensor in the world frame. Raises WorldError for an unknown robot."""
        car = self._pose(self._index(robot), frame)
        x, y, z = (car.matrix() @ [*SENSOR, 1.0])[:3]
        return Pose(float(x), float(y), float(z), car.roll, car.pitch, car.yaw)

    def body(self, robot: str) -> Body:
        """The recording car. Raises WorldError for an unknown robot."""
        size = self._actors[self._index(robot)].vehicle.size
        x, y, z = SENSOR
        return Body(label=LABEL, size=size, center=(-x, -y, size[2] / 2 - z))

    def scan(self, robot: str, frame: int) -> Scan:
        """One scan: all rays at the frame's time. Raises WorldError for an unknown robot."""
        return self.scan_with_actors(robot, frame)[0]

    def scan_with_actors(self, robot: str, frame: int) -> tuple[Scan, NDArray[np.int16]]:
        """A scan and, for each point, the index of its vehicle in `ground_truth`, or -1."""
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
            velocity=self._velocity(robot, frame),
        )
        return scan, returns.actors

    def ground_truth(self, frame: int) -> GroundTruth:
        """The boxes of all vehicles, the robots' own first. Computes the scans of all robots."""
        frame %= self.frame_count
        truth: GroundTruth = self._recent.get(("truth", 0, frame), lambda: self._truth(frame))
        return truth

    def actors(self, frame: int) -> tuple[Boxes, tuple[str, ...]]:
        """Boxes and names of all vehicles, seen or not, in the order of their indices."""
        sizes = np.array([actor.vehicle.size for actor in self._actors])
        poses = [self._pose(index, frame) for index in range(len(self._actors))]
        centers = [
            (pose.matrix() @ [0.0, 0.0, height / 2, 1.0])[:3]
            for pose, height in zip(poses, sizes[:, 2], strict=True)
        ]
        boxes = Boxes(
            centers=np.array(centers),
            sizes=sizes,
            headings=np.array([wrap_heading(pose.yaw) for pose in poses]),
            scores=np.ones(len(poses)),
            labels=(LABEL,) * len(poses),
        )
        return boxes, tuple(actor.identity for actor in self._actors)

    @cached_property
    def _static(self) -> Mesh:
        rng = np.random.default_rng((self._seed, 2))
        return join([self._street.ground(), surroundings(self._street, rng)])

    def _index(self, robot: str) -> int:
        if robot not in self.robots:
            raise WorldError(
                f"robot {robot!r} is not on this road; it has {self.robots[0]} to {self.robots[-1]}"
            )
        return self.robots.index(robot)

    def _pose(self, actor: int, frame: int) -> Pose:
        """Of a vehicle: the ground below its middle."""
        x, y, z, yaw, pitch, roll = self._actors[actor].states[frame % self.frame_count].tolist()
        return Pose(x, y, z, roll, pitch, yaw)

    def _velocity(self, robot: str, frame: int) -> tuple[float, float, float]:
        """Difference to the next pose (to the previous one in the last frame)."""
        frame = min(frame % self.frame_count, self.frame_count - 2)
        a, b = self.pose(robot, frame), self.pose(robot, frame + 1)
        return ((b.x - a.x) * RATE_HZ, (b.y - a.y) * RATE_HZ, (b.z - a.z) * RATE_HZ)

    def _scene(self, frame: int) -> Scene:
        """Kept because all robots of a frame share it."""

        def make() -> Scene:
            meshes = [
                actor.vehicle.mesh.moved(self._pose(index, frame).matrix())
                for index, actor in enumerate(self._actors)
            ]
            return Scene(self._static, meshes)

        scene: Scene = self._recent.get(("scene", 0, frame), make)
        return scene

    def _returns(self, index: int, frame: int) -> Returns:
        name = f"{self._file_key}-{self.robots[index]}-{frame:04d}"

        def shoot() -> Returns:
            rng = np.random.default_rng((self._seed, 3, index, frame))
            return self._scene(frame).shoot(self.pose(self.robots[index], frame), rng)

        return kept_returns(self._cache, name, shoot)

    def _truth(self, frame: int) -> GroundTruth:
        visible = np.zeros(len(self._actors), dtype=np.int64)
        for robot in self.robots:
            _, actors = self.scan_with_actors(robot, frame)
            visible += np.bincount(actors[actors >= 0], minlength=len(visible))
        boxes, identities = self.actors(frame)
        return GroundTruth(boxes=boxes, ids=identities, visible_points=visible)
