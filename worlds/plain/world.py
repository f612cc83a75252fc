"""Folders of plain scans as one world, by their times or by their numbers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np

from perception.detector import configuration
from perception.types import Boxes
from swarm.errors import WorldError
from swarm.geometry import Matrix, Points, Pose, pose_of
from worlds.base import GroundTruth, Scan, SelfDescribing
from worlds.detector_choice import LOOKED_AT, choose_detector
from worlds.plain.folders import check_robots, robots_of
from worlds.plain.poses import NAMES, find_poses, read_poses
from worlds.plain.times import NAME, FrameIndex, Velocity, difference, read_times
from worlds.recent import Recent
from worlds.scans import read_scan
from worlds.world_file import FILE_NAME, Age, Offset, Place, WorldFile, read_world_file, settings_of

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
    clock_offset_s: Offset | None = None
    """How far its clock, by which its times are, is ahead of the other robots'; None: nobody has
    looked."""


class WorldSettings(WorldFile, frozen=True, forbid_unknown_fields=True):
    """Of the world."""

    max_scan_age_s: Age | None = None
    """A frame in which a robot's newest scan is older sees nothing of that robot; None: as
    `FrameIndex` has it."""


class ScansWorld(SelfDescribing):
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
        settings = read_world_file(data, WorldSettings, RobotSettings, self.robots)
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
        self._by_time = _frame_index(data, self._files, of, settings)
        if self._by_time is not None:
            self.timings = self._by_time.timings
            self.frame_count, self.rate_hz = self._by_time.frame_count, self._by_time.rate_hz
            notes = self._by_time.notes
        else:
            self.frame_count = min(len(its) for its in self._files.values())
            self.rate_hz = settings.rate_hz or RATE_HZ
            notes = tuple(_unequal(self._files, self.frame_count))
        self.notes: tuple[str, ...] = notes
        """What is odd about data that can be used all the same."""
        self.comm_range_m = settings.comm_range_m
        self._recent = Recent(MAX_KEPT)
        self.detector: str
        self.choices: tuple[str, ...]
        if settings.detector is not None:
            self.detector, self.choices = settings.detector, ()
        else:
            self.detector, self.choices = choose_detector(list(self._first_scans()))
        self.range_m = configuration(self.detector).sensor.range_m

    def pose(self, robot: str, frame: int) -> Pose:
        """See `worlds.base.World`."""
        return pose_of(self._poses[robot][self._index(robot, frame)[0]])

    def scan(self, robot: str, frame: int) -> Scan:
        """The scan of a frame, as `worlds.scans.read_scan` reads it; empty when it is too old."""
        index, fresh = self._index(robot, frame)
        return Scan(
            robot=robot,
            frame=frame % self.frame_count,
            points=self._read(robot, index) if fresh else np.zeros((0, 3), dtype=np.float32),
            pose=pose_of(self._poses[robot][index]),
            velocity=self._velocity(robot, index),
        )

    def ground_truth(self, frame: int) -> GroundTruth:
        """None: nobody knows what was really there."""
        return GroundTruth(Boxes.empty(), (), np.zeros(0, dtype=np.int64))

    def _index(self, robot: str, frame: int) -> tuple[int, bool]:
        """Which scan a frame shows of a robot, and whether it is fresh."""
        if robot not in self._files:
            raise WorldError(f"robot {robot!r} has no scans; there are {', '.join(self.robots)}")
        frame %= self.frame_count
        return (frame, True) if self._by_time is None else self._by_time.index(robot, frame)

    def _first_scans(self) -> Iterator[Points]:
        for robot, its in self._files.items():
            for index in range(min(LOOKED_AT, len(its))):
                with suppress(WorldError):  # told when a frame shows it
                    yield self._read(robot, index)

    def _read(self, robot: str, index: int) -> Points:
        path = self._files[robot][index]
        points: Points = self._recent.get(path, lambda: read_scan(path))
        return points

    def _velocity(self, robot: str, index: int) -> Velocity:
        """Difference to the next scan's pose (of the last scan, to the one before)."""
        poses = self._poses[robot]
        if self._by_time is not None:
            return self._by_time.velocity(robot, index, poses)
        index = min(index, self.frame_count - 2)
        if index < 0:
            return (0.0, 0.0, 0.0)
        return difference(poses[index], poses[index + 1], 1 / self.rate_hz)


def _frame_index(
    data: Path,
    files: dict[str, list[Path]],
    of: dict[str, RobotSettings],
    settings: WorldSettings,
) -> FrameIndex | None:
    """By time where all robots have times; None: the k-th scan of each robot is frame k.

    Raises WorldError where some robots have times, and some none.
    """
    taken = {}
    for robot, its in files.items():
        first = of[robot].first
        times = read_times(data / robot, first + len(its))
        if times is not None:
            taken[robot] = times[first:] - round((of[robot].clock_offset_s or 0.0) * 1e9)
        elif of[robot].clock_offset_s is not None:
            raise WorldError(
                f"clock_offset_s in [robots.{robot}] of {data / FILE_NAME} needs "
                f"{data / robot / NAME}, which is not there"
            )
    if taken and len(taken) < len(files):
        without = ", ".join(robot for robot in files if robot not in taken)
        raise WorldError(
            f"{data} has {NAME} for {', '.join(taken)}, and none for {without}: all robots need "
            "one, or none of them"
        )
    if not taken:
        return None
    trusted = {robot for robot, its in of.items() if its.clock_offset_s is not None}
    rate_hz, max_age_s = settings.rate_hz, settings.max_scan_age_s
    return FrameIndex(data, taken, trusted, rate_hz=rate_hz, max_age_s=max_age_s)


def _unequal(files: dict[str, list[Path]], shown: int) -> Iterator[str]:
    for robot, its in files.items():
        if len(its) > shown:
            yield (
                f"{robot} has {len(its)} scans, of which the first {shown} are shown, as another "
                "robot has no more"
            )


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
