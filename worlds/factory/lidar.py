"""A spinning LiDAR: regular rays, range noise, drop-out. All rays of a scan are shot at once."""

from __future__ import annotations

import numpy as np

from swarm.geometry import Pose
from worlds.base import Rays
from worlds.factory.actors import Solids
from worlds.factory.grid import RayGrid
from worlds.factory.layout import Floor
from worlds.factory.meshes import MeshRays
from worlds.factory.rays import CompiledRays, come_back, rays
from worlds.returns import Returns

COLUMNS = 1024
LOWEST_RAD, HIGHEST_RAD = np.radians(-25.0), np.radians(15.0)
"""Vertical field of the Velodyne VLP-32C (data sheet 63-9378); its rings are not evenly spaced,
these are."""
RINGS = (16, 32, 64)
RANGE_M = 40.0
MIN_RANGE_M = 0.3
NOISE_M = 0.02
"""Standard deviation of the range; data sheets of this class give 2 to 3 cm."""
RANGE_STEP_M = 1 / 256
"""Ranges are told in steps, as the VLP-32C tells them in 4 mm; a power of two is exact in
float32."""
DROP_OUT = 0.01
"""Share of the returns that get lost."""


class Lidar:
    """Shoots scans on one floor. Safe to use from several threads."""

    def __init__(self, floor: Floor, rings: int) -> None:
        grid = RayGrid(np.linspace(LOWEST_RAD, HIGHEST_RAD, rings), COLUMNS)
        self.rays = Rays(grid.directions(), RANGE_STEP_M)
        self._directions = self.rays.directions.reshape(-1, 3)
        self._library = rays()
        self._rays = (
            MeshRays(floor, grid, RANGE_M)
            if self._library is None
            else CompiledRays(self._library, floor, grid, RANGE_M)
        )

    @property
    def compiled(self) -> bool:
        """Whether rays are cast in C."""
        return self._library is not None

    def shoot(self, pose: Pose, own: int, bodies: Solids, rng: np.random.Generator) -> Returns:
        """One scan from a pose without roll and pitch: ring by ring from the lowest, each ring in
        ascending azimuth from 0.

        `own` is the actor that carries the sensor: it is not seen.
        """
        distance, actors = self._rays.cast(pose, own, bodies)
        noise = rng.standard_normal(len(distance), dtype=np.float32)
        luck = rng.random(len(distance), dtype=np.float32)
        limits = NOISE_M, RANGE_STEP_M, DROP_OUT, MIN_RANGE_M, RANGE_M
        if self._library is not None:
            return come_back(
                self._library, distance, actors, self._directions, noise, luck, *limits
            )
        distance += noise * np.float32(NOISE_M)
        distance = np.rint(distance / np.float32(RANGE_STEP_M)) * np.float32(RANGE_STEP_M)
        kept = luck >= DROP_OUT
        kept &= (distance >= MIN_RANGE_M) & (distance <= RANGE_M)
        index = np.flatnonzero(kept)
        return Returns(self._directions[index] * distance[index, None], actors[index])
