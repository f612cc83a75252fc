"""`fast`: ground by a grid of lowest points, objects by connected cells seen from above.

Both grids span +-RANGE_M around the sensor whatever the coordinates are, so memory is bounded.
The constants were chosen on the OPV2V sample, see docs/scene.md.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

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


def segment(points: Points) -> Segmentation:
    """Ground and objects of finite points, float32 (N, 3), sensor frame, z up, metres."""
    near = in_range(points)
    cloud = points if near.all() else points[near]
    if not len(cloud):
        return Segmentation.empty()
    x, y, z = np.ascontiguousarray(cloud.T)
    height = z - _ground_height(x, y, z)
    standing = np.flatnonzero((height > GROUND_BAND_M) & (height < CEILING_M))
    members, labels, count = _components(x[standing], y[standing])
    return Segmentation(cloud, height <= GROUND_BAND_M, standing[members], labels, count)


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


def _ground_height(
    x: NDArray[np.float32], y: NDArray[np.float32], z: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Height of the ground below each point, from the lowest returns of the cells around it."""
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
        for cells in SPREAD_CELLS:
            rise = np.float32(SLOPE * GROUND_CELL_M * cells)
            raised = axis_view + rise
            np.minimum(axis_view[cells:], raised[:-cells], out=axis_view[cells:])
            np.minimum(axis_view[:-cells], raised[cells:], out=axis_view[:-cells])
    return ground


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
