"""Folders of plain scans as one world: the k-th scan of each robot is frame k."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from perception.types import Boxes
from swarm.errors import WorldError
from swarm.geometry import Matrix, Points, Pose, pose_of
from worlds.base import RANGES_M, GroundTruth, Scan
from worlds.detector_choice import LOOKED_AT, choose_detector
from worlds.plain.folders import check_robots, robots_of
from worlds.plain.poses import NAMES, find_poses, read_poses
from worlds.recent import Recent
from worlds.scans import read_scan
from worlds.world_file import FILE_NAME, Place, WorldFile, read_world_file, settings_of

RATE_HZ = 10.0
"""Where nobody says another."""
MAX_KEPT = 32
"""Scans in memory; one of 100 000 points takes 1.2 MB."""


class RobotSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Of one robot."""

    origin: Place | None = None
    """Where the frame of its poses lies in the world; of a robot without poses, its sensor."""
    first: int = 0
    """Its scan of frame 0, for robots that began earlier than others."""


class ScansWorld:
    """A folder of robots' folders, each with scans and the sensor's poses."""

    name = "scans"

    def __init__(self, data: Path) -> None:
        """Opens all folders. Raises WorldError that names what is wrong with which."""
        data = Path(data)
        if not data.is_dir():
            raise WorldError(f"data directory {data} is not a readable directory")
        files = robots_of(data)
        check_robots(data, files)
        self.robots = tuple(files)
        settings = read_world_file(data, WorldFile, RobotSettings, self.robots)
        of = {name: settings_of(settings, name, RobotSettings, data / FILE_NAME) for name in files}
        self._files: dict[str, list[Path]] = {}
        self._poses: dict[str, list[Matrix]] = {}
        for robot, its in files.items():
            first = of[robot].first
            if not 0 <= first < len(its):
                raise WorldError(
                    f"first = {first} in [robots.{robot}] of {data / FILE_NAME} is not valid: "
                    f"0 to {len(its) - 1} are there"
                )
            poses = _poses(data / robot, len(its), of[robot].origin)
            self._files[robot], self._poses[robot] = its[first:], poses[first:]
        counts = {robot: len(its) for robot, its in self._files.items()}
        self.frame_count = min(counts.values())
        self.notes = tuple(
            f"{robot} has {count} scans, of which the first {self.frame_count} are shown, as "
            "another robot has no more"
            for robot, count in counts.items()
            if count > self.frame_count
        )
        """What is odd about data that can be used all the same."""
        self.rate_hz: float = settings.rate_hz or RATE_HZ
        self.comm_range_m = settings.comm_range_m
        self._recent = Recent(MAX_KEPT)
        self.detector: str
        self.choices: tuple[str, ...]
        if settings.detector is not None:
            self.detector, self.choices = settings.detector, ()
        else:
            looked_at = range(min(LOOKED_AT, self.frame_count))
            scans = [self._points(robot, frame) for robot in self.robots for frame in looked_at]
            self.detector, self.choices = choose_detector(scans)
        self.range_m = RANGES_M[self.detector]

    def pose(self, robot: str, frame: int) -> Pose:
        """See `worlds.base.World`."""
        return pose_of(self._placed(robot, frame))

    def scan(self, robot: str, frame: int) -> Scan:
        """The scan of a frame, as `worlds.scans.read_scan` reads it."""
        frame %= self.frame_count
        return Scan(
            robot=robot,
            frame=frame,
            points=self._points(robot, frame),
            pose=self.pose(robot, frame),
            velocity=self._velocity(robot, frame),
        )

    def ground_truth(self, frame: int) -> GroundTruth:
        """None: nobody knows what was really there."""
        return GroundTruth(Boxes.empty(), (), np.zeros(0, dtype=np.int64))

    def _points(self, robot: str, frame: int) -> Points:
        path = self._of(robot)[frame]
        points: Points = self._recent.get(path, lambda: read_scan(path))
        return points

    def _placed(self, robot: str, frame: int) -> Matrix:
        self._of(robot)
        return self._poses[robot][frame % self.frame_count]

    def _velocity(self, robot: str, frame: int) -> tuple[float, float, float]:
        """Difference to the next pose (to the one before in the last frame)."""
        if self.frame_count < 2:
            return (0.0, 0.0, 0.0)
        frame = min(frame, self.frame_count - 2)
        moved = self._placed(robot, frame + 1)[:3, 3] - self._placed(robot, frame)[:3, 3]
        x, y, z = (moved * self.rate_hz).tolist()
        return (x, y, z)

    def _of(self, robot: str) -> list[Path]:
        if robot not in self._files:
            raise WorldError(f"robot {robot!r} has no scans; there are {', '.join(self.robots)}")
        return self._files[robot]


def _poses(folder: Path, count: int, origin: Place | None) -> list[Matrix]:
    """`world_from_sensor`, one a scan. Raises WorldError."""
    placed = (origin or Place()).pose().matrix()
    path = find_poses(folder)
    if path is None:
        if origin is None:
            raise WorldError(
                f"{folder} does not say where its scans were taken: it needs {', '.join(NAMES)}, "
                f"or, of a sensor that stays, origin in [robots.{folder.name}] of {FILE_NAME}"
            )
        return [placed] * count
    poses = read_poses(path)
    if len(poses) != count:
        raise WorldError(f"{path} has {len(poses)} poses for {count} scans; it needs one a scan")
    return [placed @ pose for pose in poses]
