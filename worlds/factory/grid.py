"""The rays of a spinning LiDAR: a regular grid of elevations and azimuths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm.geometry import TWO_PI


@dataclass(frozen=True, slots=True)
class RayGrid:
    """Rings of equally many rays."""

    elevations: NDArray[np.float64]
    """(rings,), ascending, radians; none straight up or down."""
    columns: int

    def azimuths(self) -> NDArray[np.float64]:
        """(columns,): from 0, evenly spaced over a turn, radians."""
        return np.arange(self.columns, dtype=np.float64) * (TWO_PI / self.columns)

    def directions(self) -> NDArray[np.float32]:
        """(rings, columns, 3): unit vectors in the sensor's frame."""
        azimuths = self.azimuths()
        flat, up = np.cos(self.elevations)[:, None], np.sin(self.elevations)[:, None]
        return np.stack(
            [flat * np.cos(azimuths), flat * np.sin(azimuths), up + 0.0 * azimuths], axis=-1
        ).astype(np.float32)
