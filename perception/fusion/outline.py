"""What surrounds a robot, in a few points: by its outline a sender can be laid over the ego."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.scene import ground_mask
from swarm.geometry import Points

Floats = NDArray[np.float64]

CELL_M = 0.3
MIN_POINTS = 3
MIN_HEIGHT_M = 0.3
"""Of what stands in a cell: a kerb or noise is no outline."""
REACH_M = 45.0
SENT_POINTS = 72


def outline(points: Points, ground: NDArray[np.bool_] | None = None) -> Floats:
    """Places (N, 2) where something stands, one for each cell, by azimuth.

    points: float32 (M, 3), finite, metres, in the sensor's frame, as the places are.
    ground: bool (M,), which of them are ground, where that is known.
    """
    cloud = _standing(points, ground)
    if not len(cloud):
        return np.zeros((0, 2))
    cells = np.floor(cloud[:, :2] / CELL_M).astype(np.int64)
    _, index, counts = np.unique(
        cells[:, 0] * 100_000 + cells[:, 1], return_inverse=True, return_counts=True
    )
    low, high = np.full(len(counts), np.inf), np.full(len(counts), -np.inf)
    np.minimum.at(low, index, cloud[:, 2])
    np.maximum.at(high, index, cloud[:, 2])
    x, y = (np.bincount(index, cloud[:, i]) / counts for i in (0, 1))
    stands = (counts >= MIN_POINTS) & (high - low >= MIN_HEIGHT_M)
    places = np.column_stack([x, y])[stands]
    around: Floats = places[np.argsort(np.arctan2(places[:, 1], places[:, 0]), kind="stable")]
    return around


def standing(points: Points) -> NDArray[np.float32]:
    """All places (N, 2) of a cloud, as `outline`'s, where a point is not ground."""
    return _standing(points, None)[:, :2]


def _standing(points: Points, ground: NDArray[np.bool_] | None) -> Points:
    if not len(points):
        return points
    cloud = points[~(ground_mask(points) if ground is None else ground)]
    return cloud[(np.abs(cloud[:, 0]) < REACH_M) & (np.abs(cloud[:, 1]) < REACH_M)]


def thinned(places: Floats) -> Floats:
    """SENT_POINTS of an outline at most, evenly around the robot."""
    if len(places) <= SENT_POINTS:
        return places
    return places[np.linspace(0, len(places) - 1, SENT_POINTS).round().astype(np.intp)]
