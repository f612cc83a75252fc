"""What in a scan is no object: too tall or too wide for any, as walls, racks and hedges are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.scene import fast
from perception.scene.segmentation import Groups
from swarm.geometry import Points

CELL_M = 0.3
"""What stands in cells side by side is one thing."""
BIN_M = 0.5
SECTORS, SECTOR_RAD = 128, 2.0 * np.pi / 1024
"""Directions in which structure is kept, evenly around the sensor, and how wide each of them is."""
MAX_GAP_BINS = 2
"""Of height, in which nothing is seen: a canopy over a car is not one thing with it."""


def ground_and_structure(
    points: Points, tallest_m: float, widest_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of finite points, float32 (N, 3), sensor frame, z up, metres, are ground, and which of
    the others belong to what is taller or wider than any object; both bool (N,), False beyond the
    reach of `fast`.

    Tall is a column that goes on above the tallest object without a gap. What is left stands for
    itself: an object beside a wall is cut from it. Wide is the diagonal of what is connected then.
    """
    ground, structure = np.zeros((2, len(points)), dtype=np.bool_)
    near = fast.in_range(points)
    cloud = points if near.all() else points.compress(near, axis=0)
    if len(cloud):
        height = fast.heights(cloud)
        ground[near] = height <= fast.GROUND_BAND_M
        structure[near] = _structure(cloud, height, tallest_m, widest_m)
    return ground, structure


def in_sectors(points: Points) -> NDArray[np.bool_]:
    """Which points (N, 3) lie in one of SECTORS directions from the sensor."""
    apart = 2.0 * np.pi / SECTORS
    along = np.mod(np.arctan2(points[:, 1], points[:, 0]) + SECTOR_RAD / 2.0, apart)
    kept: NDArray[np.bool_] = along < SECTOR_RAD
    return kept


def _structure(
    cloud: Points, height: NDArray[np.float32], tallest_m: float, widest_m: float
) -> NDArray[np.bool_]:
    found = _tall(cloud, height, tallest_m)
    members, labels, count = fast.objects(
        cloud, np.where(found, np.float32(0.0), height), CELL_M, min_points=1
    )
    if count:
        groups = Groups.of(labels, count)
        x, y = np.ascontiguousarray(cloud.take(members, axis=0)[:, :2].T)
        long, wide = (groups.maximum(along) - groups.minimum(along) for along in (x, y))
        found[members] = (np.hypot(long, wide) > widest_m)[labels]
    return found


def _tall(cloud: Points, height: NDArray[np.float32], tallest_m: float) -> NDArray[np.bool_]:
    """Points in columns in which something goes on above that height."""
    x, y = np.floor(cloud[:, :2] / CELL_M).astype(np.int64).T
    x, y = x - x.min(), y - y.min()
    column = x * (int(y.max()) + 1) + y
    standing = (height > fast.GROUND_BAND_M) & (height < fast.CEILING_M)
    above = np.zeros(int(column.max()) + 1, dtype=np.bool_)
    above[column[standing & (height > tallest_m)]] = True
    tall = np.flatnonzero(above)
    number = np.full(len(above), -1, dtype=np.int64)
    number[tall] = np.arange(len(tall))
    below = np.flatnonzero(standing & above[column] & (height <= tallest_m))
    bins = int(np.ceil(tallest_m / BIN_M))
    level = np.minimum((height[below] / BIN_M).astype(np.int64), bins - 1)
    held = np.zeros((len(tall), bins), dtype=np.bool_)
    held[number[column[below]], level] = True
    seen = np.zeros(len(tall), dtype=np.bool_)
    empty, gap = np.zeros((2, len(tall)), dtype=np.int64)
    for filled in held.T:
        empty = np.where(filled | ~seen, 0, empty + 1)
        gap = np.maximum(gap, empty)
        seen |= filled
    above[tall[gap > MAX_GAP_BINS]] = False
    found: NDArray[np.bool_] = standing & above[column]
    return found
