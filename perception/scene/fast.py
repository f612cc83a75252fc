"""`fast`: ground by a grid of lowest points, objects by connected cells seen from above.

Both grids span +-RANGE_M around the sensor whatever the coordinates are, so memory is bounded.
The constants were chosen on the OPV2V sample, see docs/scene.md.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from perception.kernels.library import places, pointer
from perception.scene.segmentation import Groups, Segmentation
from swarm.geometry import Points

RANGE_M = 120.0
"""Points further from the sensor along x or y are left out."""
GROUND_CELL_M = 1.0
GROUND_BAND_M = 0.25
"""Points up to this far above their cell's ground height are ground."""
SLOPE = 0.08
"""Ground seen in a cell bounds the ground height of cells beside it, plus this much per metre."""
SPREAD_CELLS = (1, 2, 4)
"""Steps of that bound, 7 m along each axis in all: far away, cars stand on ground that returns
nothing beside them. Ground that rises more than 10 % would become objects."""
PIT_M = 1.0
"""A cell this far below all its neighbours holds a stray return (a reflection), not ground."""
CEILING_M = 4.5
"""Points higher above the ground are overhead (ceilings, canopies): seen from above they would
join all that stands below them."""
OBJECT_CELL_M = 0.4
"""Objects are apart when at least one cell between them is empty."""
MIN_POINTS = 5

_GROUND_SIDE = int(2 * RANGE_M / GROUND_CELL_M)
_OBJECT_SIDE = int(2 * RANGE_M / OBJECT_CELL_M)
_EIGHT_NEIGHBOURS = np.ones((3, 3), dtype=np.int8)
_STEPS = np.array(SPREAD_CELLS, dtype=np.int64)
_RISES = (SLOPE * GROUND_CELL_M * _STEPS).astype(np.float32)


def segment(points: Points) -> Segmentation:
    """Ground and objects of finite points, float32 (N, 3), sensor frame, z up, metres."""
    near = in_range(points)
    cloud = points if near.all() else points.compress(near, axis=0)
    if not len(cloud):
        return Segmentation.empty()
    height = heights(cloud)
    members, labels, count = objects(cloud, height)
    return Segmentation(cloud, height <= GROUND_BAND_M, members, labels, count)


def ground(points: Points) -> NDArray[np.bool_]:
    """Which of finite points (N, 3) are ground, as `segment` has it; False beyond its reach."""
    near = in_range(points)
    found: NDArray[np.bool_] = np.zeros(len(points), dtype=np.bool_)
    if near.all():
        np.less_equal(heights(points), GROUND_BAND_M, out=found)
    else:
        found[near] = heights(points.compress(near, axis=0)) <= GROUND_BAND_M
    return found


def in_range(points: Points) -> NDArray[np.bool_]:
    """Which points the grids hold: bool (N,)."""
    # Slightly inside the border, so that rounding cannot give a cell outside the grid.
    limit = RANGE_M - 1e-3
    near: NDArray[np.bool_] = np.abs(points[:, 0]) < limit
    near &= np.abs(points[:, 1]) < limit
    return near


def _cells(x: NDArray[np.float32], y: NDArray[np.float32], size: float) -> NDArray[np.int32]:
    side = np.int32(2 * RANGE_M / size)
    offset, scale = np.float32(RANGE_M), np.float32(1.0 / size)
    row = ((x + offset) * scale).astype(np.int32)
    cells: NDArray[np.int32] = row * side + ((y + offset) * scale).astype(np.int32)
    return cells


def heights(points: Points) -> NDArray[np.float32]:
    """Height of points in reach above the ground below them, (N,)."""
    compiled = places()
    if compiled is None or not len(points):
        x, y, z = np.ascontiguousarray(points.T)
        height: NDArray[np.float32] = z - _ground_height(x, y, z)
        return height
    points = np.ascontiguousarray(points)
    border = max(SPREAD_CELLS)
    grids = np.empty((2, _GROUND_SIDE + 2 * border, _GROUND_SIDE + 2 * border), dtype=np.float32)
    cells = np.empty(len(points), np.int32)
    height = np.empty(len(points), np.float32)
    compiled.heights_above(
        *(pointer(points), len(points), RANGE_M, 1.0 / GROUND_CELL_M, _GROUND_SIDE, PIT_M),
        *(pointer(_STEPS), pointer(_RISES), len(_STEPS), border),
        *(pointer(cells), pointer(grids), pointer(height)),
    )
    return height


def _ground_height(
    x: NDArray[np.float32], y: NDArray[np.float32], z: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Height of the ground below each point, from the lowest returns of the cells around it."""
    if not len(z):
        return z
    cells = _cells(x, y, GROUND_CELL_M)
    groups = Groups.of(cells, _GROUND_SIDE**2)
    lowest = np.full(_GROUND_SIDE**2, np.inf, dtype=np.float32)
    lowest[groups.keys] = groups.minimum(z)
    ground = _spread(_without_pits(lowest.reshape(_GROUND_SIDE, _GROUND_SIDE)))
    return ground.ravel()[cells]


def _without_pits(lowest: NDArray[np.float32]) -> NDArray[np.float32]:
    """The grid with cells far below all eight neighbours raised to the lowest of these."""
    padded = np.pad(lowest, 1, constant_values=np.inf)
    sides = np.minimum(padded[:, :-2], padded[:, 2:])
    rows = np.minimum(sides, padded[:, 1:-1])
    around = np.minimum(np.minimum(rows[:-2], rows[2:]), sides[1:-1])
    return np.where((lowest < around - np.float32(PIT_M)) & np.isfinite(around), around, lowest)


def _spread(lowest: NDArray[np.float32]) -> NDArray[np.float32]:
    """The grid with each cell bounded by the cells around it plus SLOPE times the distance."""
    ground = lowest.copy()
    for axis_view in (ground, ground.T):
        for cells, rise in zip(SPREAD_CELLS, _RISES, strict=True):
            raised = axis_view + rise
            np.minimum(axis_view[cells:], raised[:-cells], out=axis_view[cells:])
            np.minimum(axis_view[:-cells], raised[cells:], out=axis_view[:-cells])
    return ground


def objects(
    points: Points, height: NDArray[np.float32]
) -> tuple[NDArray[np.intp], NDArray[np.int32], int]:
    """Positions of the points in connected cells of MIN_POINTS or more, their labels, how many."""
    compiled = places()
    if compiled is None:
        standing = np.flatnonzero((height > GROUND_BAND_M) & (height < CEILING_M))
        x, y = np.ascontiguousarray(points.take(standing, axis=0)[:, :2].T)
        members, labels, count = _components(x, y)
        return standing[members], labels, count
    points = np.ascontiguousarray(points)
    members, found = np.empty(len(points), np.int64), np.zeros(2, np.int64)
    labels, cells = (np.empty(len(points), np.int32) for _ in range(2))
    grid = np.empty(_OBJECT_SIDE**2, np.int32)
    stack = np.empty(max(_OBJECT_SIDE**2, len(points) + 1), np.int32)
    compiled.find_objects(
        *(pointer(points), pointer(height), len(points), GROUND_BAND_M, CEILING_M),
        *(RANGE_M, 1.0 / OBJECT_CELL_M, _OBJECT_SIDE, MIN_POINTS),
        *(pointer(cells), pointer(grid), pointer(stack)),
        *(pointer(members), pointer(labels), pointer(found)),
    )
    kept, count = found.tolist()
    return members[:kept], labels[:kept], count


def _components(
    x: NDArray[np.float32], y: NDArray[np.float32]
) -> tuple[NDArray[np.intp], NDArray[np.int32], int]:
    """Positions of the points in connected cells of MIN_POINTS or more, their labels, how many."""
    cells = _cells(x, y, OBJECT_CELL_M)
    occupied = np.zeros((_OBJECT_SIDE, _OBJECT_SIDE), dtype=np.bool_)
    occupied.ravel()[cells] = True
    labelled = np.zeros_like(occupied, dtype=np.int32)
    window = _bounds(occupied)
    found = ndimage.label(occupied[window], _EIGHT_NEIGHBOURS, output=labelled[window])
    labels = labelled.ravel()[cells]
    kept = np.bincount(labels, minlength=found + 1) >= MIN_POINTS
    members = np.flatnonzero(kept[labels])
    compact = np.cumsum(kept, dtype=np.int32) - 1
    return members, compact[labels[members]], int(np.count_nonzero(kept))


def _bounds(occupied: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The rectangle that holds all occupied cells: labelling the empty rest costs as much."""
    rows, columns = (np.flatnonzero(occupied.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0), slice(0)
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
