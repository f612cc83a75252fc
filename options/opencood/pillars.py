"""Points sorted into pillars, first come, first served, as spconv's voxel generator does.

A pillar keeps its first `max_points` points; when `max_voxels` pillars have begun, points that
would begin another are dropped. Points on the border of the range are outside.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from options.opencood.config import OpenCoodConfig


@dataclass(frozen=True, slots=True)
class Pillars:
    """V pillars with P points in all.

    points float32 (P, 4) x, y, z, intensity in the network's frame; pillar int64 (P,): whose point
    it is; cells int64 (V, 2): column (along x) and row (along y) of each pillar.
    """

    points: NDArray[np.float32]
    pillar: NDArray[np.int64]
    cells: NDArray[np.int64]


def sort_into_pillars(chunks: Iterable[NDArray[np.float32]], config: OpenCoodConfig) -> Pillars:
    """The pillars of a cloud given in chunks of float32 (n, 4) in the network's frame.

    Memory is bounded by one chunk and by what full pillars hold, however many points there are.
    """
    nx, ny = config.grid
    low, high = (np.array(side, np.float32) for side in np.split(np.array(config.lidar_range), 2))
    size = np.array(config.voxel_size, dtype=np.float32)
    filled = np.zeros(nx * ny, dtype=np.int64)
    kept, cells = [np.zeros((0, 4), np.float32)], [np.zeros(0, np.int64)]
    for chunk in chunks:
        inside = ((chunk[:, :3] > low) & (chunk[:, :3] < high)).all(axis=1)
        chunk = chunk[inside]
        column, row = np.floor((chunk[:, :2] - low[:2]) / size[:2]).astype(np.int64).T
        cell = row * nx + column
        room = (column < nx) & (row < ny)
        room[room] = filled[cell[room]] < config.max_points
        chunk, cell = chunk[room], cell[room]
        early = filled[cell] + _rank_in_group(cell) < config.max_points
        chunk, cell = chunk[early], cell[early]
        filled += np.bincount(cell, minlength=nx * ny)
        kept.append(chunk)
        cells.append(cell)
    points, cell = np.concatenate(kept), np.concatenate(cells)
    pillars, first = np.unique(cell, return_index=True)
    pillars = pillars[np.argsort(first)][: config.max_voxels]
    number = np.full(nx * ny, -1, dtype=np.int64)
    number[pillars] = np.arange(len(pillars))
    begun = number[cell] >= 0
    return Pillars(
        points=points[begun],
        pillar=number[cell[begun]],
        cells=np.stack([pillars % nx, pillars // nx], axis=1),
    )


def _rank_in_group(group: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many equal values come before each one."""
    order = np.argsort(group, kind="stable")
    ordered = group[order]
    begins = np.flatnonzero(np.diff(ordered, prepend=-1))
    rank = np.empty(len(group), dtype=np.int64)
    rank[order] = np.arange(len(group)) - np.repeat(begins, np.diff(begins, append=len(group)))
    return rank
