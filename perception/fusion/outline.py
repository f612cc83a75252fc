"""What surrounds a robot, in a few points: by its outline a sender can be laid over the ego."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.kernels.library import places, pointer
from perception.scene import ground_mask
from swarm.geometry import Points

Floats = NDArray[np.float64]

CELL_M = 0.3
MIN_POINTS = 3
MIN_HEIGHT_M = 0.3
"""Of what stands in a cell: a kerb or noise is no outline."""
REACH_M = 45.0
_HALF_CELLS = 151
"""A cell more than reach, for rounding."""
SENT_POINTS = 72


def outline(points: Points, ground: NDArray[np.bool_] | None = None) -> Floats:
    """Places (N, 2) where something stands, one for each cell, by azimuth.

    points: float32 (M, 3), finite, metres, in the sensor's frame, as the places are.
    ground: bool (M,), which of them are ground, where that is known.
    """
    if not len(points):
        return np.zeros((0, 2))
    counts, low, high, x, y = _gathered(points, ground_mask(points) if ground is None else ground)
    stands = (counts >= MIN_POINTS) & (high - low >= MIN_HEIGHT_M)
    around = np.column_stack([x[stands] / counts[stands], y[stands] / counts[stands]])
    azimuth = np.arctan2(around[:, 1], around[:, 0])
    turned: Floats = around[np.argsort(azimuth, kind="stable")]
    return turned


def _gathered(
    points: Points, ground: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], Floats, Floats, Floats, Floats]:
    """Of the standing points in each cell: how many, lowest and highest z, sums of x and of y. In
    the order of the cells, x first."""
    compiled = places()
    if compiled is not None:
        points, ground = np.ascontiguousarray(points), np.ascontiguousarray(ground)
        cells, grid = np.empty(len(points), np.int32), np.empty((2 * _HALF_CELLS) ** 2, np.int32)
        count = np.empty(len(points), np.int64)
        low, high, x, y = np.empty((4, len(points)))
        used = compiled.gather_cells(
            *(pointer(points), pointer(ground), len(points), REACH_M, CELL_M, _HALF_CELLS),
            *(pointer(part) for part in (cells, grid, count, low, high, x, y)),
        )
        return count[:used], low[:used], high[:used], x[:used], y[:used]
    cloud = _standing(points, ground)
    if not len(cloud):
        return np.zeros(0, np.int64), *np.zeros((4, 0))
    cells = np.floor(cloud[:, :2] / CELL_M).astype(np.int64)
    keys = cells[:, 0] * 100_000 + cells[:, 1]
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=keys.min() - 1))
    count = np.diff(starts, append=len(keys)).astype(np.int64)
    ranked = cloud[order].astype(np.float64)
    index = np.repeat(np.arange(len(count)), count)
    low = np.minimum.reduceat(ranked[:, 2], starts)
    high = np.maximum.reduceat(ranked[:, 2], starts)
    sums = [np.bincount(index, ranked[:, i]).astype(np.float64) for i in (0, 1)]
    return count, low, high, sums[0], sums[1]


def standing(points: Points) -> NDArray[np.float32]:
    """All places (N, 2) of a cloud, as `outline`'s, where a point is not ground."""
    return _standing(points, ground_mask(points))[:, :2]


def _standing(points: Points, ground: NDArray[np.bool_]) -> Points:
    near = np.abs(points[:, 0]) < REACH_M
    near &= np.abs(points[:, 1]) < REACH_M
    near &= ~ground
    return points.compress(near, axis=0)


def thinned(places: Floats) -> Floats:
    """SENT_POINTS of an outline at most, evenly around the robot."""
    if len(places) <= SENT_POINTS:
        return places
    return places[np.linspace(0, len(places) - 1, SENT_POINTS).round().astype(np.intp)]
