"""Synthetic spinning-LiDAR scans for the codec's tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def room_scan(
    rings: int = 16,
    columns: int = 256,
    seed: int = 0,
    noise_m: float = 0.02,
    drop: float = 0.1,
    phase: float = 0.001,
) -> NDArray[np.float32]:
    """A sensor 1.8 m above the floor of a 30 m x 20 m hall with a box in it, ring by ring."""
    rng = np.random.default_rng(seed)
    elevation = np.radians(np.linspace(-25.0, 10.0, rings))[:, None]
    azimuth = phase + np.arange(columns) * (2 * np.pi / columns)
    ahead, aside = np.abs(np.cos(azimuth)), np.abs(np.sin(azimuth))
    flat = np.minimum(15.0 / np.maximum(ahead, 1e-9), 10.0 / np.maximum(aside, 1e-9))
    flat = np.where(np.abs(azimuth - 1.0) < 0.2, 5.0, flat)
    range_m = flat / np.cos(elevation)
    floor = 1.8 / np.maximum(-np.sin(elevation), 1e-6)
    range_m = np.minimum(range_m, floor) + rng.normal(0.0, noise_m, range_m.shape)
    rays = np.stack(
        np.broadcast_arrays(
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ),
        axis=-1,
    )
    kept = rng.random(range_m.shape) >= drop
    cloud: NDArray[np.float32] = (rays * range_m[..., None])[kept].astype(np.float32)
    return cloud
