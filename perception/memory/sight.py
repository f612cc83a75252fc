"""What a scan shows of places: something there, nothing there, or not the place at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes
from swarm.geometry import Points

Counts = NDArray[np.int64]

CORE = 0.7
"""Of a body's half width that a ray must meet to count: its edge is not known so well."""
BEYOND_M = 0.3
"""A return this far behind a body has passed its place."""
ABOVE_FLOOR_M, BELOW_TOP_M = 0.2, 0.15


class Sight:
    """One scan, sorted by azimuth."""

    def __init__(self, points: Points) -> None:
        """`points`: float32 (N, 3), finite, metres, in the sensor's frame, ground included."""
        azimuth = np.arctan2(points[:, 1], points[:, 0])
        order = np.argsort(azimuth, kind="stable")
        self._azimuth = azimuth[order]
        self._away = np.hypot(points[order, 0], points[order, 1])
        self._slope = points[order, 2] / np.maximum(self._away, 0.01)

    def of(self, boxes: Boxes) -> tuple[Counts, Counts]:
        """Of upright boxes (K) in the sensor's frame: how many returns came from their places, and
        how many from behind, through them. Both 0: the place is hidden, or out of sight."""
        there, through = np.zeros((2, len(boxes)), dtype=np.int64)
        away = np.hypot(*boxes.centers[:, :2].T)
        azimuth = np.arctan2(boxes.centers[:, 1], boxes.centers[:, 0])
        width = CORE * boxes.sizes[:, :2].min(axis=1) / 2.0
        reach = np.hypot(*boxes.sizes[:, :2].T) / 2.0
        low = boxes.centers[:, 2] - boxes.sizes[:, 2] / 2.0 + ABOVE_FLOOR_M
        high = boxes.centers[:, 2] + boxes.sizes[:, 2] / 2.0 - BELOW_TOP_M
        for i in np.flatnonzero(away > reach):
            ray = self._between(azimuth[i], float(np.arcsin(min(1.0, width[i] / away[i]))))
            height = self._slope[ray] * away[i]
            met = self._away[ray][(height >= low[i]) & (height <= high[i])]
            there[i] = np.count_nonzero(np.abs(met - away[i]) <= reach[i])
            through[i] = np.count_nonzero(met > away[i] + reach[i] + BEYOND_M)
        return there, through

    def _between(self, azimuth: float, half: float) -> NDArray[np.intp]:
        """Returns within an angle of an azimuth, which may pass the cut at pi."""
        parts = []
        for turn in (-2.0 * np.pi, 0.0, 2.0 * np.pi):
            first, last = np.searchsorted(
                self._azimuth, [azimuth + turn - half, azimuth + turn + half]
            )
            parts.append(np.arange(first, last))
        return np.concatenate(parts)
