"""The scan pattern of a spinning sensor, found in the points themselves.

A spinning LiDAR sends its rays on a few fixed elevations (rings) and at equal steps of azimuth
(columns). Both are estimated from one cloud in any order, also from a part of one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.types import Points

MAX_RINGS = 256
MAX_COLUMNS = 8192
MAX_CELLS = 1 << 20
ELEVATION_STEP_RAD = 2.0**-18
"""Elevations are kept in these steps: 0.2 mm at 100 m."""
_RISE_BINS = 8192
"""Per unit of sin(elevation): 0.007 degrees, far below the distance of two rings."""
_AZIMUTH_BINS = 1 << 15
_SAMPLE = 8192
_TOGETHER = 0.85
_FLOAT32_RAD = 5e-7
"""What float32 may add to the angle between a point and its ray."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Directions of a grid: of the rings (R,) and of the columns (C,), float64."""

    cos_elevation: NDArray[np.float64]
    sin_elevation: NDArray[np.float64]
    cos_azimuth: NDArray[np.float64]
    sin_azimuth: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SensorGrid:
    """Rings and columns of a sensor.

    elevations: int32 (R,) in ELEVATION_STEP_RAD; columns: rays a turn, at equal steps; phase:
    azimuth of column 0 in radians.
    """

    elevations: NDArray[np.int32]
    columns: int
    phase: float

    @property
    def rings(self) -> int:
        """Number of rings."""
        return len(self.elevations)

    def rays(self) -> Rays:
        """The directions of all rays."""
        elevation = self.elevations * ELEVATION_STEP_RAD
        azimuth = self.phase + np.arange(self.columns) * (math.tau / self.columns)
        return Rays(np.cos(elevation), np.sin(elevation), np.cos(azimuth), np.sin(azimuth))


@dataclass(frozen=True, slots=True)
class Places:
    """Where N points lie in a grid."""

    cell: NDArray[np.int32]
    """column * rings + ring, (N,); -1 for a point on no ring."""
    range_m: NDArray[np.float32]
    apart: NDArray[np.float32]
    """Distance of the unit vectors to the point and along its ray, (N,), rounding included."""


def find_grid(cloud: Points) -> tuple[SensorGrid, Places] | None:
    """The scan pattern of a finite cloud and each point's place; None when there is none."""
    if not len(cloud):
        return None
    x, y, z = np.ascontiguousarray(cloud.T)
    flat = np.sqrt(x * x + y * y)
    range_m = np.sqrt(flat * flat + z * z)
    scale = np.float32(1.0) / np.maximum(range_m, np.float32(1e-3))
    rise = z * scale
    found = _find_rings(rise)
    if found is None:
        return None
    ring, elevations = found
    azimuth = np.arctan2(y, x)
    columns = _find_columns(azimuth[:: max(1, len(azimuth) // _SAMPLE)])
    if columns is None or len(elevations) * columns[0] > MAX_CELLS:
        return None
    grid = SensorGrid(elevations, *columns)
    position = (azimuth - np.float32(grid.phase)) * np.float32(grid.columns / math.tau)
    nearest = np.rint(position)
    cell = (nearest.astype(np.int32) % grid.columns) * np.int32(grid.rings) + ring
    rays = grid.rays()
    level = flat * scale
    turn = (position - nearest) * (level * np.float32(math.tau / grid.columns))
    tilt = rise - rays.sin_elevation.astype(np.float32)[ring]
    reach = level - rays.cos_elevation.astype(np.float32)[ring]
    apart = np.sqrt(turn * turn + tilt * tilt + reach * reach) + np.float32(_FLOAT32_RAD)
    return grid, Places(np.where(ring >= 0, cell, -1), range_m, apart)


def _find_rings(
    rise: NDArray[np.float32],
) -> tuple[NDArray[np.int32], NDArray[np.int32]] | None:
    """Ring of each point (-1: none) and elevations, from sin(elevation); None without rings.

    Rings are the runs of occupied bins of a fine histogram.
    """
    bins = ((rise + np.float32(1.0)) * np.float32(_RISE_BINS)).astype(np.int32)
    histogram = np.bincount(bins, minlength=2 * _RISE_BINS + 2)
    occupied = histogram > 0
    run = np.cumsum(occupied[1:] & ~occupied[:-1])
    run = np.concatenate([[0], run]) - (not occupied[0])
    runs = int(run[-1]) + 1
    sizes = np.bincount(run[occupied], histogram[occupied], minlength=runs)
    # a few points between the rings are no ring
    kept = sizes >= max(2.0, 0.02 * len(rise) / runs)
    rings = int(kept.sum())
    if not 0 < rings <= MAX_RINGS:
        return None
    ring_of_run = np.where(kept, np.cumsum(kept) - 1, -1)
    ring = np.where(occupied, ring_of_run[run], -1).astype(np.int32)[bins]
    sums = np.bincount(ring + 1, rise, minlength=rings + 1)[1:]
    elevations = np.arcsin(np.clip(sums / sizes[kept], -1.0, 1.0))
    return ring, np.rint(elevations / ELEVATION_STEP_RAD).astype(np.int32)


def _find_columns(azimuth: NDArray[np.float32]) -> tuple[int, float] | None:
    """Columns a turn and phase: the first frequency at which the azimuths fall together again."""
    bins = ((azimuth + np.float32(math.pi)) * np.float32(_AZIMUTH_BINS / math.tau)).astype(np.int32)
    histogram = np.bincount(bins % _AZIMUTH_BINS, minlength=_AZIMUTH_BINS)
    together = np.abs(np.fft.rfft(histogram)[: MAX_COLUMNS + 1]) / len(azimuth)
    apart = int(np.argmax(together < 0.5))
    peak = apart + int(np.argmax(together[apart:] > _TOGETHER))
    if together[apart] >= 0.5 or together[peak] <= _TOGETHER:
        return None
    after = together[peak:]
    width = int(np.argmax(after <= _TOGETHER)) or len(after)
    columns = peak + int(np.argmax(after[:width]))
    angle = np.angle(np.exp(1j * columns * azimuth.astype(np.float64)).sum())
    return columns, float(angle) / columns
