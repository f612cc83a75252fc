"""OPV2V's LiDAR: CARLA's ray-cast sensor with 64 rings.

Settings are those that OPV2V publishes with every scenario (data_protocol.yaml, `lidar`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm.errors import WorldError
from swarm.geometry import TWO_PI, Pose
from worlds.returns import Returns
from worlds.road.meshes import Mesh

RINGS = 64
ELEVATIONS = np.radians(np.linspace(2.0, -25.0, RINGS))
"""`upper_fov` to `lower_fov`; the scans' points lie within 0.001 degrees of these."""
COLUMNS = 1016
"""1 300 000 points a second / 20 turns a second / 64 rings, rounded up; also measured."""
RANGE_M = 120.0
NOISE_M = 0.02
"""`noise_stddev`, along the ray."""
DROP_OUT = 0.1
"""`dropoff_general_rate`: this share of the returns gets lost."""
STATIC = -1
"""Index of everything that is no actor."""


class Scene:
    """All surfaces at one moment."""

    def __init__(self, ground: Mesh, actors: list[Mesh]) -> None:
        """`actors` in the order of their indices. Raises WorldError without Open3D."""
        self._o3d = _open3d()
        self._scene = self._o3d.t.geometry.RaycastingScene(nthreads=1)
        for mesh in (ground, *actors):
            self._scene.add_triangles(
                self._o3d.core.Tensor(mesh.vertices.astype(np.float32)),
                self._o3d.core.Tensor(mesh.triangles.astype(np.uint32)),
            )

    def shoot(self, pose: Pose, rng: np.random.Generator) -> Returns:
        """One scan; all rays leave at once. Ring by ring from the highest, each ring clockwise from
        a random first azimuth."""
        azimuth = rng.uniform(0.0, TWO_PI) - np.arange(COLUMNS) * (TWO_PI / COLUMNS)
        flat, up = np.cos(ELEVATIONS)[:, None], np.sin(ELEVATIONS)[:, None]
        towards = np.stack(
            [flat * np.cos(azimuth), flat * np.sin(azimuth), up + 0.0 * azimuth], axis=-1
        ).astype(np.float32)
        towards = towards.reshape(-1, 3)[rng.random(RINGS * COLUMNS) >= DROP_OUT]
        rays = np.empty((len(towards), 6), dtype=np.float32)
        rays[:, :3] = pose.x, pose.y, pose.z
        rays[:, 3:] = towards @ pose.matrix()[:3, :3].T.astype(np.float32)
        found = self._scene.cast_rays(self._o3d.core.Tensor(rays), nthreads=1)
        distance: NDArray[np.float32] = found["t_hit"].numpy()
        index = np.flatnonzero(distance < RANGE_M)
        noise = rng.standard_normal(len(index), dtype=np.float32) * np.float32(NOISE_M)
        points = towards[index] * (distance[index] + noise)[:, None]
        actors = found["geometry_ids"].numpy()[index].astype(np.int16) - np.int16(1)
        return Returns(points, actors)


def _open3d() -> Any:
    """Open3D, imported when the first ray is cast: it takes a second."""
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise WorldError(
            f"the simulated road needs Open3D, which cannot be loaded: {error}; "
            "pip install 'coadapt-edge[open3d]' brings it, and on Debian it needs libegl1, libgl1, "
            "libgomp1, libusb-1.0-0 and libx11-6"
        ) from error
    return open3d
