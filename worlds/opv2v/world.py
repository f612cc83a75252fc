"""Recorded OPV2V scenarios, in the data set's own layout.

    <scenario>/data_protocol.yaml
    <scenario>/<vehicle>/<frame>.pcd     points in the sensor's frame
    <scenario>/<vehicle>/<frame>.yaml    lidar_pose, vehicles

OPV2V was recorded in CARLA, whose frames are left-handed; everything that leaves this module is
right-handed (carla.py).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from perception.detector import configuration
from perception.types import Boxes, clean_points
from swarm.body import Body
from swarm.errors import WorldError
from swarm.geometry import Points, Pose, invert, transform
from worlds.base import GroundTruth, Scan, SelfDescribing
from worlds.cache import ScanCache
from worlds.clouds.pcd import read_pcd
from worlds.opv2v import carla
from worlds.recent import Recent

RATE_HZ = 10.0
RANGE_M = 120.0
MAX_CACHED = 128
"""Scans, descriptions and truths in memory; a scan takes 0.7 MB."""
BOX_MARGIN_M = 0.1
"""Points this far outside a box still count as the vehicle's: range noise and box rounding."""


class Opv2vWorld(SelfDescribing):
    """One recorded scenario; every vehicle folder is a robot (a roadside unit, whose folder has a
    negative number, is none). Parsed files are kept in memory, and scans on disk if asked."""

    name = "opv2v"
    rate_hz = RATE_HZ
    range_m = RANGE_M
    detector = "road"

    def __init__(self, data: Path, cache: Path | None = None) -> None:
        """Opens a scenario directory, or a directory that holds exactly one.

        `cache` is a directory in which parsed scans are kept between runs, since reading ascii
        takes 20 times as long as reading an array.
        Raises WorldError when there is no scenario, or when a vehicle lacks a file of a frame.
        """
        self._directory = _find_scenario(Path(data))
        self.robots, self.frame_names = _list_frames(self._directory)
        self.frame_count = len(self.frame_names)
        self._disk = None if cache is None else ScanCache(cache)
        self._recent = Recent(MAX_CACHED)

    def frame_index(self, name: str) -> int:
        """The index of a frame by its name in the data set (`006220`) or its own number.

        Raises WorldError for a frame that is not there.
        """
        if name in self.frame_names:
            return self.frame_names.index(name)
        if name.isdigit() and int(name) < self.frame_count and len(name) < 6:
            return int(name)
        raise WorldError(
            f"frame {name!r} is not in {self._directory}; it has {self.frame_names[0]} to "
            f"{self.frame_names[-1]}, or 0 to {self.frame_count - 1}"
        )

    def pose(self, robot: str, frame: int) -> Pose:
        """The vehicle's sensor in the world frame."""
        facts = self._facts(robot, frame)
        try:
            return carla.pose(*(float(value) for value in facts["lidar_pose"]))
        except (KeyError, TypeError, ValueError) as error:
            raise WorldError(
                f"{self._path(robot, frame, 'yaml')} has no valid lidar_pose: {error!r}"
            ) from error

    def body(self, robot: str) -> Body:
        """The vehicle as another one describes it in the first frame; the usual body where nobody
        does."""
        own_from_world = invert(self.pose(robot, 0).matrix())
        identities, boxes = self._described(0)
        if robot not in identities:
            return configuration(self.detector).usual_body
        at = identities.index(robot)
        x, y, z = (own_from_world @ [*boxes.centers[at], 1.0])[:3].tolist()
        length, width, height = boxes.sizes[at].tolist()
        return Body(label=boxes.labels[at], size=(length, width, height), center=(x, y, z))

    def scan(self, robot: str, frame: int) -> Scan:
        """One recorded scan in the right-handed sensor frame."""
        frame %= self.frame_count
        points = self._recent.get(
            ("points", robot, frame),
            lambda: self._points(self._path(robot, frame, "pcd")),
        )
        return Scan(
            robot=robot,
            frame=frame,
            points=points,
            pose=self.pose(robot, frame),
            velocity=self._velocity(robot, frame),
        )

    def ground_truth(self, frame: int) -> GroundTruth:
        """Boxes of all vehicles that any recording vehicle lists in this frame."""
        frame %= self.frame_count
        truth: GroundTruth = self._recent.get(("truth", "", frame), lambda: self._truth(frame))
        return truth

    def _points(self, path: Path) -> Points:
        if self._disk is None:
            return carla.points(clean_points(read_pcd(path)))
        try:
            stat = path.stat()
        except OSError as error:
            raise WorldError(f"point cloud {path} cannot be read: {error}") from error
        # The file's time and size: another file of the same name is another scan.
        name = f"opv2v-{path.parent.name}-{path.stem}-{stat.st_mtime_ns:x}-{stat.st_size:x}"
        kept = self._disk.read(name, columns=3)
        if kept is not None:
            kept.setflags(write=False)
            return kept
        points = carla.points(clean_points(read_pcd(path)))
        self._disk.write(name, points)
        return points

    def _velocity(self, robot: str, frame: int) -> tuple[float, float, float]:
        """Difference to the next recorded pose (to the previous one in the last frame)."""
        if self.frame_count < 2:
            return (0.0, 0.0, 0.0)
        frame = min(frame, self.frame_count - 2)
        a, b = self.pose(robot, frame), self.pose(robot, frame + 1)
        return ((b.x - a.x) * RATE_HZ, (b.y - a.y) * RATE_HZ, (b.z - a.z) * RATE_HZ)

    def _described(self, frame: int) -> tuple[tuple[str, ...], Boxes]:
        """Names and boxes of all vehicles that any recording vehicle lists."""
        listed: dict[str, dict[str, Any]] = {}
        try:
            for robot in self.robots:
                for identity, vehicle in (self._facts(robot, frame).get("vehicles") or {}).items():
                    listed.setdefault(str(identity), vehicle)
            identities = tuple(sorted(listed))
            return identities, carla.boxes([listed[identity] for identity in identities])
        except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
            raise WorldError(
                f"frame {self.frame_names[frame]} of {self._directory} has a malformed vehicle: "
                f"{error!r}"
            ) from error

    def _truth(self, frame: int) -> GroundTruth:
        identities, boxes = self._described(frame)
        visible = np.zeros(len(boxes), dtype=np.int64)
        for robot in self.robots:
            scan = self.scan(robot, frame)
            points = transform(scan.pose.matrix(), scan.points)
            visible += [int(points_in_box(points, boxes, i).sum()) for i in range(len(boxes))]
        return GroundTruth(boxes=boxes, ids=identities, visible_points=visible)

    def _facts(self, robot: str, frame: int) -> dict[str, Any]:
        frame %= self.frame_count
        facts: dict[str, Any] = self._recent.get(
            ("facts", robot, frame), lambda: _read_yaml(self._path(robot, frame, "yaml"))
        )
        return facts

    def _path(self, robot: str, frame: int, suffix: str) -> Path:
        if robot not in self.robots:
            raise WorldError(
                f"robot {robot!r} is not in {self._directory}; it has {', '.join(self.robots)}"
            )
        return self._directory / robot / f"{self.frame_names[frame % self.frame_count]}.{suffix}"


def points_in_box(points: Points, boxes: Boxes, index: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """(N,) whether points (N, 3) lie in one box (same frame), with `BOX_MARGIN_M` around it."""
    center, size = boxes.centers[index], boxes.sizes[index] / 2 + BOX_MARGIN_M
    offset = points - center.astype(np.float32)
    near = np.flatnonzero((np.abs(offset) <= np.hypot(size[0], size[1]) + size[2]).all(axis=1))
    inside = np.zeros(len(points), dtype=np.bool_)
    turned = transform(
        invert(Pose(0, 0, 0, yaw=float(boxes.headings[index])).matrix()), offset[near]
    )
    inside[near] = (np.abs(turned) <= size).all(axis=1)
    return inside


def _find_scenario(data: Path) -> Path:
    try:
        if not data.is_dir():
            raise WorldError(f"data directory {data} is not a readable directory")
        if (data / "data_protocol.yaml").is_file():
            return data
        found = sorted(p.parent for p in data.glob("*/data_protocol.yaml")) or sorted(
            p.parent for p in data.glob("*/*/data_protocol.yaml")
        )
    except OSError as error:
        raise WorldError(f"data directory {data} cannot be read: {error}") from error
    if len(found) != 1:
        raise WorldError(
            f"data directory {data} holds {len(found)} OPV2V scenarios (folders with "
            "data_protocol.yaml); name one of them"
        )
    return found[0]


def _list_frames(scenario: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the vehicles and of the frames, of which every vehicle must have both files."""
    files: dict[str, set[str]] = {}
    try:
        for folder in sorted(scenario.iterdir()):
            if folder.is_dir() and not folder.name.startswith("-"):
                names = {p.name for p in folder.iterdir() if p.suffix in (".pcd", ".yaml")}
                if names:
                    files[folder.name] = names
    except OSError as error:
        raise WorldError(f"scenario {scenario} cannot be read: {error}") from error
    # A scan that no vehicle describes, like the last one of a recording cut off, is no frame.
    described = (name for name in set().union(*files.values()) if name.endswith(".yaml"))
    frames = sorted({Path(name).stem for name in described})
    if not frames:
        raise WorldError(f"scenario {scenario} has no <vehicle>/<frame>.pcd and .yaml")
    for vehicle, names in files.items():
        for frame in frames:
            for name in (f"{frame}.pcd", f"{frame}.yaml"):
                if name not in names:
                    raise WorldError(
                        f"vehicle {vehicle} of scenario {scenario} lacks {name}; every vehicle "
                        "needs the .pcd and .yaml of every frame"
                    )
    return tuple(files), tuple(frames)


def _read_yaml(path: Path) -> dict[str, Any]:
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        facts = yaml.load(path.read_text(), Loader=loader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise WorldError(f"frame description {path} cannot be read: {error}") from error
    if not isinstance(facts, dict):
        raise WorldError(f"frame description {path} is not a mapping")
    return facts
