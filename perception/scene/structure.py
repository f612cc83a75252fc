"""What in a scan is no object: too tall for any, as walls, racks and pillars are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.scene import fast
from swarm.geometry import Points

CELL_M = 0.3
"""Side of a column, seen from above."""
BIN_M, MAX_GAP_BINS = 0.5, 3
"""So many of height may hold nothing, as between the decks of a rack: what hangs higher over an
object is not one thing with it."""
SECTORS, SECTOR_RAD = 128, 2.0 * np.pi / 1024
"""Structure is kept in so many directions, evenly around the sensor, each of them so wide."""


def ground_and_structure(
    points: Points, tallest_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of finite points, float32 (N, 3), sensor frame, z up, metres, are ground, and which
    stand in columns that go on above the tallest object; both bool (N,), no point is both, and none
    beyond the reach of `fast` is either.

    An object beside a wall is cut from it, but for what it has in the wall's own columns.
    """
    near, height, structure = _measured(points, tallest_m)
    ground: NDArray[np.bool_] = near & (height <= fast.GROUND_BAND_M)
    return ground, structure


def above_objects(points: Points, tallest_m: float) -> NDArray[np.bool_]:
    """Which of finite points, float32 (N, 3), sensor frame, z up, metres, are structure above the
    tallest object: bool (N,). Nothing that an object has in a wall's column is among them."""
    _, height, structure = _measured(points, tallest_m)
    found: NDArray[np.bool_] = structure & (height > tallest_m)
    return found


def in_sectors(points: Points) -> NDArray[np.bool_]:
    """Which points (N, 3) lie in one of the directions in which structure is kept: bool (N,)."""
    apart = 2.0 * np.pi / SECTORS
    along = np.mod(np.arctan2(points[:, 1], points[:, 0]) + SECTOR_RAD / 2.0, apart)
    kept: NDArray[np.bool_] = along < SECTOR_RAD
    return kept


def _measured(
    points: Points, tallest_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.bool_]]:
    """Which points are in the reach of `fast`, bool (N,), how high these stand over the ground,
    float32 (N,), and which of them are structure, bool (N,)."""
    near = fast.in_range(points)
    height, structure = np.zeros(len(points), np.float32), np.zeros(len(points), np.bool_)
    cloud = points if near.all() else points.compress(near, axis=0)
    if len(cloud):
        above = fast.heights(cloud)
        height[near], structure[near] = above, _tall(cloud, above, tallest_m)
    return near, height, structure


def _tall(cloud: Points, height: NDArray[np.float32], tallest_m: float) -> NDArray[np.bool_]:
    """Points in columns in which something stands that goes on above that height."""
    x, y = np.floor(cloud[:, :2] / CELL_M).astype(np.int64).T
    x, y = x - x.min(), y - y.min()
    column = x * (int(y.max()) + 1) + y
    standing = (height > fast.GROUND_BAND_M) & (height < fast.CEILING_M)
    above = np.zeros(int(column.max()) + 1, dtype=np.bool_)
    above[column[standing & (height > tallest_m)]] = True
    tall = np.flatnonzero(above)
    within = np.flatnonzero(standing & above[column])
    held = np.zeros((len(tall), int(np.ceil(fast.CEILING_M / BIN_M)) + 1), dtype=np.bool_)
    held[np.searchsorted(tall, column[within]), (height[within] / BIN_M).astype(np.int64)] = True
    seen, reached = np.zeros((2, len(tall)), dtype=np.bool_)
    empty, gap = np.zeros((2, len(tall)), dtype=np.int64)
    for level, filled in enumerate(held.T):
        # Between the lowest return and the first one above the tallest object.
        gap = np.where(filled & ~reached, np.maximum(gap, empty), gap)
        empty = np.where(filled, 0, empty + seen)
        seen |= filled
        reached |= filled & (level * BIN_M >= tallest_m)
    above[tall[gap > MAX_GAP_BINS]] = False
    found: NDArray[np.bool_] = (height > fast.GROUND_BAND_M) & above[column]
    return found
