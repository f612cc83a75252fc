"""The square grid around the ego on which seen ground is counted."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

CELL_M = 1.0


class Grid:
    """G x G cells of 1 m, centred on (x, y) in the world frame; row = y, column = x."""

    def __init__(self, x: float, y: float, half_m: float) -> None:
        self.cell_m = CELL_M
        self.half = math.ceil(half_m / CELL_M)
        self.cells = 2 * self.half
        self.x, self.y = x, y

    def contains(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which world positions lie on the grid."""
        reach = self.half * CELL_M
        inside: NDArray[np.bool_] = (np.abs(x - self.x) < reach) & (np.abs(y - self.y) < reach)
        return inside

    def visible(self, x: float, y: float, visible_m: NDArray[np.float32]) -> NDArray[np.bool_]:
        """The cells that a sensor at (x, y) sees: bool (G, G).

        `visible_m` (S,) tells for S equal sectors of world azimuth from 0 (east) how far. A cell
        counts when its centre does. The sensor is taken to be in the middle of its own cell: that
        moves the mask by at most 0.71 m and makes angles and distances the same for all robots.
        """
        area = np.zeros((self.cells, self.cells), dtype=bool)
        reach = self.cells
        column, row = x - self.x, y - self.y
        if not len(visible_m) or not (abs(column) < reach and abs(row) < reach):
            return area
        column, row = math.floor(column) + self.half, math.floor(row) + self.half
        limit = min(reach, math.ceil(max(0.0, float(visible_m.max()))))
        left, right = max(0, column - limit), min(self.cells, column + limit + 1)
        low, high = max(0, row - limit), min(self.cells, row + limit + 1)
        if left >= right or low >= high:
            return area
        turn, distance = _polar(reach)
        window = np.s_[
            low - row + reach : high - row + reach, left - column + reach : right - column + reach
        ]
        sector = (turn[window] * len(visible_m)).astype(np.intp)
        area[low:high, left:right] = distance[window] <= visible_m[sector]
        return area


@lru_cache(maxsize=4)
def _polar(reach: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Azimuth as a share of a full turn in [0, 1), and distance in metres, of the cells around
    the middle one: two float32 (2 reach + 1, 2 reach + 1)."""
    offset = np.arange(-reach, reach + 1) * CELL_M
    east, north = np.meshgrid(offset, offset)
    turn = (np.arctan2(north, east) / (2.0 * np.pi) % 1.0).astype(np.float32)
    turn[turn >= 1.0] = 0.0
    distance = np.hypot(east, north).astype(np.float32)
    turn.flags.writeable = distance.flags.writeable = False
    return turn, distance
