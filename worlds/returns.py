"""What a simulated LiDAR's rays hit, and keeping it between runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm.geometry import Points
from worlds.cache import ScanCache


@dataclass(frozen=True, slots=True)
class Returns:
    """The points of one scan, float32 (N, 3) in the sensor's frame, and the actor that each lies
    on, int16 (N,), -1 for none."""

    points: Points
    actors: NDArray[np.int16]


def kept_returns(cache: ScanCache | None, name: str, shoot: Callable[[], Returns]) -> Returns:
    """The scan of that name from the cache, else what `shoot` returns, which is then kept. Its
    arrays cannot be written to."""
    kept = cache.read(name, columns=4) if cache else None
    if kept is not None:
        found = Returns(np.ascontiguousarray(kept[:, :3]), kept[:, 3].astype(np.int16))
    else:
        found = shoot()
        if cache:
            actors = found.actors.astype(np.float32)
            cache.write(name, np.column_stack([found.points, actors]))
    found.points.setflags(write=False)
    found.actors.setflags(write=False)
    return found
