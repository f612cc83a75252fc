"""How many ground-truth vehicles a scene description names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.scene import describe, segment
from perception.scene.description import own_body
from swarm.geometry import Points, transform
from worlds.base import Scan, World

REACH_M = 50.0
MIN_VISIBLE_POINTS = 10
MAX_OFFSET_M = 1.5
MAX_FOOTPRINT_RATIO = 2.5
STRICT_SHARE = 0.7


@dataclass(frozen=True, slots=True)
class Target:
    """A vehicle that a description should name."""

    visible: Points
    """The scan's points inside the vehicle's box, sensor frame."""
    footprint_m2: float
    """Length times width of the box."""


@dataclass(frozen=True, slots=True)
class Found:
    """How a description names a target."""

    described: bool
    """An object has its centroid within 1.5 m of that of the visible points, and a footprint under
    2.5 times the vehicle's."""
    strict: bool
    """Such an object's axis-aligned box also holds 70 % of the visible points."""


def targets(world: World, scan: Scan) -> Iterator[Target]:
    """The vehicles within 50 m of the sensor with 10 or more points in the scan.

    All vehicles that the world knows in that frame are asked for, but the scanning one itself.
    """
    truth = world.ground_truth(scan.frame)
    in_world = transform(scan.pose.matrix(), scan.points)
    for index, actor in enumerate(truth.ids):
        center, size = truth.boxes.centers[index], truth.boxes.sizes[index]
        if actor == scan.robot or np.hypot(*(center[:2] - (scan.pose.x, scan.pose.y))) > REACH_M:
            continue
        inside = _inside(in_world - center, size, truth.boxes.headings[index])
        if np.count_nonzero(inside) >= MIN_VISIBLE_POINTS:
            yield Target(scan.points[inside], float(size[0] * size[1]))


def _inside(
    offsets: NDArray[np.floating], size: NDArray[np.float64], heading: float
) -> NDArray[np.bool_]:
    cos, sin = np.cos(heading), np.sin(heading)
    along = offsets[:, 0] * cos + offsets[:, 1] * sin
    across = offsets[:, 1] * cos - offsets[:, 0] * sin
    own = np.stack([along, across, offsets[:, 2]], axis=1)
    inside: NDArray[np.bool_] = (np.abs(own) <= size / 2).all(axis=1)
    return inside


def match(points: Points, method: str, targets: Iterable[Target]) -> list[Found]:
    """Whether and how well the description of a scan by a method names each target."""
    scene = describe(points, method)
    lows, highs = _extents(points, method)
    centroids = np.array([each.centroid for each in scene.objects]).reshape(-1, 3)
    footprints = np.array([each.size[0] * each.size[1] for each in scene.objects])
    found = []
    for target in targets:
        offsets = np.linalg.norm(centroids - target.visible.mean(axis=0), axis=1)
        limit = MAX_FOOTPRINT_RATIO * target.footprint_m2
        candidates = np.flatnonzero((offsets <= MAX_OFFSET_M) & (footprints < limit))
        shares = [
            ((target.visible >= lows[k]) & (target.visible <= highs[k])).all(axis=1).mean()
            for k in candidates
        ]
        found.append(Found(bool(shares), max(shares, default=0.0) >= STRICT_SHARE))
    return found


def _extents(points: Points, method: str) -> tuple[Points, Points]:
    """The least and greatest coordinates of the objects of a description, in its order."""
    found = segment(points, method)
    others = np.flatnonzero(~own_body(found))
    members = [found.points[found.members[found.labels == label]] for label in others]
    lows = np.array([each.min(axis=0) for each in members]).reshape(-1, 3)
    highs = np.array([each.max(axis=0) for each in members]).reshape(-1, 3)
    return lows, highs
