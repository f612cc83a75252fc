"""What a LiDAR's rays hit on a factory floor and what comes back of them, in C (rays.c)."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perception.kernels.library import load, pointer
from swarm.geometry import Pose
from worlds.factory.actors import STATIC, Solids
from worlds.factory.grid import RayGrid
from worlds.factory.layout import Floor
from worlds.returns import Returns

Floats = NDArray[np.float32]
Owners = NDArray[np.int16]

_VERSION = 2
"""Of the functions of rays.c: a library that was built from another source is not called."""
_FUNCTIONS = {
    "lay_floor": "v dp ll pp",
    "hit_boxes": "v pppp l i d p ppl pl pp",
    "measure": "v ppp ll pp",
    "come_back": "l ppppp l fffff pp",
}
_MARGIN_M = 1.0
"""What is this far beyond the range cannot come back, whatever the noise."""
_NOBODY = -2


@cache
def rays() -> ctypes.CDLL | None:
    """rays.c; None where it was not compiled."""
    return load(Path(__file__).parent, "_rays", _VERSION, _FUNCTIONS)


class CompiledRays:
    """Rays on one floor. Safe to use from several threads."""

    def __init__(self, library: ctypes.CDLL, floor: Floor, grid: RayGrid, range_m: float) -> None:
        self._library = library
        self._shape = len(grid.elevations), grid.columns
        self._range_m = range_m
        self._slope = np.tan(grid.elevations)
        level = np.abs(self._slope) < 1e-9
        self._flat = (1.0 / np.where(level, 1e-9, self._slope)).astype(np.float32)
        self._longer = (1.0 / np.cos(grid.elevations)).astype(np.float32)
        azimuths = grid.azimuths()
        self._azimuths = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
        low, high = floor.boxes[:, :3], floor.boxes[:, 3:]
        self._static = Solids(
            owner=np.full(len(low), STATIC, dtype=np.int16),
            centers=(low + high) / 2,
            halves=(high - low) / 2,
            headings=np.zeros(len(low)),
        )

    def cast(self, pose: Pose, own: int, bodies: Solids) -> tuple[Floats, Owners]:
        """The distance to what each ray hits first, or infinity, and whose body it is."""
        rings, columns = self._shape
        way = np.empty((columns, rings), dtype=np.float32)
        who = np.empty((columns, rings), dtype=np.int16)
        self._library.lay_floor(
            *(pose.z, pointer(self._slope), rings, columns, pointer(way), pointer(who))
        )
        place = np.array([pose.x, pose.y, pose.z, pose.yaw])
        for solids, unseen, reach_m in (
            (self._static, _NOBODY, self._range_m + _MARGIN_M),
            (bodies, own, self._range_m),
        ):
            self._library.hit_boxes(
                *(pointer(solids.centers), pointer(solids.halves), pointer(solids.headings)),
                *(pointer(solids.owner), len(solids.owner), unseen, reach_m, pointer(place)),
                *(pointer(self._slope), pointer(self._flat), rings),
                *(pointer(self._azimuths), columns, pointer(way), pointer(who)),
            )
        distance = np.empty(rings * columns, dtype=np.float32)
        actors = np.empty(rings * columns, dtype=np.int16)
        self._library.measure(
            *(pointer(way), pointer(who), pointer(self._longer), rings, columns),
            *(pointer(distance), pointer(actors)),
        )
        return distance, actors


def come_back(
    library: ctypes.CDLL,
    distance: Floats,
    actors: Owners,
    directions: Floats,
    noise: Floats,
    luck: Floats,
    *limits: float,
) -> Returns:
    """The points of rays (N, 3) whose `luck`, 0 to 1, and distance suffice.

    `limits`: the noise's standard deviation and the step of ranges in metres, the share that is
    lost, the least and the most distance.
    """
    count = len(distance)
    points = np.empty((count, 3), dtype=np.float32)
    owners = np.empty(count, dtype=np.int16)
    kept = library.come_back(
        *(pointer(distance), pointer(actors), pointer(directions), pointer(noise), pointer(luck)),
        *(count, *limits, pointer(points), pointer(owners)),
    )
    return Returns(points[:kept], owners[:kept])
