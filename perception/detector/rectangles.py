"""Rectangles around clusters, seen from above.

A vehicle shows a LiDAR one or two of its sides, so its points lie along an L. The heading is the
one under which the points are closest to the sides of their bounding rectangle: "closeness" of
Zhang et al., "Efficient L-Shape Fitting for Vehicle Detection Using Laser Scanners" (IV 2017),
tried at fixed steps for all clusters at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.scene.segmentation import Groups

STEP_RAD = np.pi / 60
MIN_CLOSENESS_M = 0.05
"""Points closer to a side than this count alike: range noise, and no division by zero."""
MAX_POINTS = 96
"""A cluster's points beyond this many do not change its heading."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Rectangles:
    """N rectangles: heading float64 (N,) in [0, pi/2) of the first axis, and the bounds along both
    axes as (N,) coordinates in the turned frame."""

    headings: Floats
    low: Floats
    """(N, 2)"""
    high: Floats
    """(N, 2)"""


def fit(points: NDArray[np.float32], labels: NDArray[np.int32], count: int) -> Rectangles:
    """The best rectangle of each cluster.

    Args:
        points: float32 (K, 2), metres.
        labels: (K,) cluster of each point, 0 to count - 1, each used.
        count: number of clusters.
    """
    groups = Groups.of(labels, count)
    thinned = _thin(groups, len(points))
    sample = points[thinned]
    sampled = Groups.of(labels[thinned], count)
    angles = np.arange(0.0, np.pi / 2, STEP_RAD)
    best = np.full(count, -np.inf)
    headings = np.zeros(count)
    keys = labels[thinned][sampled.order]
    ordered = sample[sampled.order]
    for angle in angles:
        cos, sin = np.float32(np.cos(angle)), np.float32(np.sin(angle))
        closest = np.full(len(keys), np.inf, dtype=np.float32)
        for along in (ordered @ np.array([cos, sin]), ordered @ np.array([-sin, cos])):
            low = np.minimum.reduceat(along, sampled.starts)[keys]
            high = np.maximum.reduceat(along, sampled.starts)[keys]
            np.minimum(closest, np.minimum(along - low, high - along), out=closest)
        score = np.add.reduceat(1.0 / np.maximum(closest, MIN_CLOSENESS_M), sampled.starts)
        better = score > best
        best[better], headings[better] = score[better], angle
    low, high = _bounds(points, groups, labels, headings)
    return Rectangles(headings, low, high)


def _thin(groups: Groups, total: int) -> NDArray[np.intp]:
    """Positions of at most about MAX_POINTS evenly spread points of each cluster."""
    sizes = np.diff(groups.starts, append=total)
    stride = np.repeat(np.maximum(sizes // MAX_POINTS, 1), sizes)
    rank = np.arange(total) - np.repeat(groups.starts, sizes)
    kept: NDArray[np.intp] = groups.order[rank % stride == 0]
    return kept


def _bounds(
    points: NDArray[np.float32], groups: Groups, labels: NDArray[np.int32], headings: Floats
) -> tuple[Floats, Floats]:
    """Extent of all points of each cluster in its turned frame: two float64 (N, 2)."""
    cos, sin = np.cos(headings)[labels], np.sin(headings)[labels]
    u = cos * points[:, 0] + sin * points[:, 1]
    v = cos * points[:, 1] - sin * points[:, 0]
    low = np.stack([groups.minimum(u), groups.minimum(v)], axis=1)
    high = np.stack([groups.maximum(u), groups.maximum(v)], axis=1)
    return low, high
