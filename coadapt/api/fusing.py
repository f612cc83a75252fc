"""Fusing scans of several robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coadapt.api.cloud import Cloud, PoseLike, ScanLike, as_cloud
from perception.detector import configuration
from perception.fusion.base import Fusion
from perception.types import Boxes
from swarm.defaults import ALGORITHM
from swarm.errors import ScanError
from swarm.geometry import Matrix, Pose, invert, pose_of
from worlds.base import GroundTruth, Scan

USUAL = "factory"
"""The detector of scans that are too small to tell."""


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Fused:
    """What an ego sees together with others. All of it is in the ego's sensor's frame: x forward,
    y left, z up, metres."""

    boxes: Boxes
    """What is published: above the detector's operating point, without the robots themselves."""
    known: Boxes
    """The other robots' bodies, where their poses say that they are."""
    bytes: dict[str, int]
    """What each of the others would send, by name."""
    rejected: dict[str, str]
    """Who is not in it, and why."""
    algorithm: str
    detector: str
    doubts: tuple[str, ...]
    """Why the detector may not suit the scans."""
    clouds: tuple[Cloud, ...]
    """What was fused, the ego's first; their poses are in the ego's frame, too."""

    def __len__(self) -> int:
        return len(self.boxes)

    def above(self, score: float) -> Boxes:
        """The boxes with at least this score."""
        return self.boxes.above(score)

    def __repr__(self) -> str:
        sent = ", ".join(f"{size} bytes of {name}" for name, size in self.bytes.items())
        left_out = "".join(f"; without {name}: {why}" for name, why in self.rejected.items())
        doubts = f", which may not suit: {'; '.join(self.doubts)}" if self.doubts else ""
        return (
            f"Fused({self.boxes!r}, {self.algorithm} with detector {self.detector}{doubts}, "
            f"{sent or 'the ego alone'}{left_out})"
        )


def fuse(
    parts: Sequence[Cloud | Scan | tuple[ScanLike, PoseLike]],
    algorithm: str | Fusion = ALGORITHM,
    detector: str | None = None,
) -> Fused:
    """Encodes, decodes and fuses scans as a swarm would: the first is the ego's, in whose frame the
    result is.

    Args:
        parts: scans that have a pose, or pairs (scan, pose); poses are `Pose`s, (x, y, z, roll,
            pitch, yaw) or (4, 4) matrices world_from_sensor. One alone is detected alone.
        algorithm: early, late, intermediate, ... or a `Fusion` of one's own; `single` is the ego.
        detector: factory (people, robots, forklifts; 25 m around) or road (vehicles; 140 m ahead).
            None takes the one that was trained on scans like these; the result names it, and has
            doubts where it does not suit them either.

    >>> import coadapt
    >>> floor = coadapt.world("factory", robots=2, rings=16)
    >>> fused = coadapt.fuse([floor.scan("R1", 0), floor.scan("R2", 0)], algorithm="late")
    >>> fused.detector, list(fused.bytes), fused.above(0.9).labels[:1]
    ('factory', ['R2'], ('forklift',))

    Raises ScanError for scans or poses that cannot be used or are missing, PerceptionError for an
    unknown algorithm or detector.
    """
    from perception.fusion.known import bodies
    from worlds.cooperative.fusing import SINGLE, fuse_frame

    clouds = _named([_part(part) for part in parts])
    if not clouds:
        raise ScanError("there is nothing to fuse; give the ego's scan first, then the others")
    name, doubts = _suiting(clouds, detector)
    configuration(name)
    alone = len(clouds) == 1 or algorithm == SINGLE
    held = _Held(clouds[:1] if alone else clouds, name)
    fused = fuse_frame(held, 0, held.robots[0], held.robots, SINGLE if alone else algorithm)
    ego_from_world = invert(_pose(clouds[0]))
    return Fused(
        boxes=fused.boxes.transformed(ego_from_world),
        known=bodies(fused.known).transformed(ego_from_world),
        bytes=fused.bytes,
        rejected=fused.rejected,
        algorithm=SINGLE if alone else algorithm if isinstance(algorithm, str) else algorithm.name,
        detector=name,
        doubts=doubts,
        clouds=tuple(
            Cloud(one.points, ego_from_world @ _pose(one), one.name) for one in held.clouds
        ),
    )


class _Held:
    """Scans of one moment behind the interface of a world."""

    name = "scans"
    rate_hz = 10.0
    frame_count = 1

    def __init__(self, clouds: Sequence[Cloud], detector: str) -> None:
        self.clouds = clouds
        self.detector = detector
        self.range_m = configuration(detector).sensor.range_m
        self.robots = tuple(cloud.name for cloud in clouds)

    def pose(self, robot: str, frame: int) -> Pose:
        return pose_of(_pose(self._of(robot)))

    def scan(self, robot: str, frame: int) -> Scan:
        points = self._of(robot).points
        return Scan(robot, 0, points, self.pose(robot, frame), velocity=(0.0, 0.0, 0.0))

    def ground_truth(self, frame: int) -> GroundTruth:
        return GroundTruth(Boxes.empty(), (), np.zeros(0, dtype=np.int64))

    def _of(self, robot: str) -> Cloud:
        return self.clouds[self.robots.index(robot)]


def _part(part: Cloud | Scan | tuple[ScanLike, PoseLike]) -> Cloud:
    if isinstance(part, (Cloud, Scan)):
        return as_cloud(part)
    if not isinstance(part, tuple) or len(part) != 2:
        raise ScanError(
            f"a part to fuse is a {type(part).__name__}; allowed: a scan that has a pose "
            "(coadapt.scan(file, pose)), or a pair (scan, pose)"
        )
    return as_cloud(*part)


def _named(clouds: list[Cloud]) -> list[Cloud]:
    """With a name each, which no other has; an ego that is alone stands at the origin."""
    named: list[Cloud] = []
    for number, cloud in enumerate(clouds, start=1):
        name = cloud.name or ("ego" if number == 1 else f"scan {number}")
        if cloud.pose is None and len(clouds) > 1:
            raise ScanError(
                f"{name} has no pose: without the sensors' poses in one world scans cannot be "
                "fused; give coadapt.scan(file, pose), or a pair (scan, pose)"
            )
        if any(name == other.name for other in named):
            name = f"{name} ({number})"
        named.append(Cloud(cloud.points, np.eye(4) if cloud.pose is None else cloud.pose, name))
    return named


def _pose(cloud: Cloud) -> Matrix:
    if cloud.pose is None:
        raise ScanError(f"{cloud.name or 'a scan'} has no pose")
    return cloud.pose


def _suiting(clouds: Sequence[Cloud], named: str | None) -> tuple[str, tuple[str, ...]]:
    """The detector that was named, or suits the scans best, and why it may not suit them."""
    from perception.detector.suits import best_detector, misfits, profile

    seen = profile([cloud.points for cloud in clouds])
    if seen is None:
        return named or USUAL, ()
    name = named or best_detector(seen)
    return name, misfits(seen, configuration(name))
