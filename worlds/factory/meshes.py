"""What a LiDAR's rays hit on a factory floor, in Open3D and NumPy; for want of a compiler."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm.errors import WorldError
from swarm.geometry import TWO_PI, Pose
from worlds.factory.actors import STATIC, Solids
from worlds.factory.grid import RayGrid
from worlds.factory.layout import Floor, triangles

Floats = NDArray[np.float64]


class MeshRays:
    """The same as `worlds.factory.rays.CompiledRays`."""

    def __init__(self, floor: Floor, grid: RayGrid, range_m: float) -> None:
        self._floor = floor
        self._elevations = grid.elevations
        self._columns = grid.columns
        self._rays = grid.directions()
        self._range_m = range_m
        self._lock = threading.Lock()
        self._scene: Any = None

    def cast(
        self, pose: Pose, own: int, bodies: Solids
    ) -> tuple[NDArray[np.float32], NDArray[np.int16]]:
        """The distance to what each ray hits first, or infinity, and whose body it is."""
        distance = self._static(pose)
        actors = np.full(len(distance), STATIC, dtype=np.int16)
        ray, hit, owner = self._bodies(pose, own, bodies)
        # The nearest body of each ray is written last.
        order = np.argsort(-hit, kind="stable")
        ray, hit, owner = ray[order], hit[order], owner[order]
        nearer = hit < distance[ray]
        ray = ray[nearer]
        distance[ray], actors[ray] = hit[nearer], owner[nearer]
        return distance, actors

    def _static(self, pose: Pose) -> NDArray[np.float32]:
        """(rings * columns,): distance to the floor or to what stands on it, or infinity."""
        o3d = _open3d()
        cos, sin = np.float32(np.cos(pose.yaw)), np.float32(np.sin(pose.yaw))
        rays = np.empty((*self._rays.shape[:2], 6), dtype=np.float32)
        rays[..., :3] = pose.x, pose.y, pose.z
        x, y = self._rays[..., 0], self._rays[..., 1]
        rays[..., 3] = cos * x - sin * y
        rays[..., 4] = sin * x + cos * y
        rays[..., 5] = self._rays[..., 2]
        with self._lock:
            if self._scene is None:
                scene = o3d.t.geometry.RaycastingScene(nthreads=1)
                scene.add_triangles(*map(o3d.core.Tensor.from_numpy, triangles(self._floor.boxes)))
                self._scene = scene
            found = self._scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
        distance: NDArray[np.float32] = found["t_hit"].numpy()
        down = np.flatnonzero(self._elevations < 0)
        to_floor = (pose.z / -np.sin(self._elevations[down])).astype(np.float32)
        distance[down] = np.minimum(distance[down], to_floor[:, None])
        return distance.reshape(-1)

    def _bodies(
        self, pose: Pose, own: int, bodies: Solids
    ) -> tuple[NDArray[np.intp], NDArray[np.float32], NDArray[np.int16]]:
        """All hits of rays with bodies: ray, distance, actor."""
        offset = bodies.centers - [pose.x, pose.y, pose.z]
        cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
        x, y = cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0]
        away = np.hypot(x, y)
        radius = np.hypot(bodies.halves[:, 0], bodies.halves[:, 1])
        picked = np.flatnonzero((bodies.owner != own) & (away - radius < self._range_m))
        x, y, z, away, radius = (v[picked] for v in (x, y, offset[:, 2], away, radius))
        halves, turn = bodies.halves[picked], bodies.headings[picked] - pose.yaw

        part, ray = self._candidates(x, y, z, away, radius, halves[:, 2])
        cos, sin = np.cos(turn)[part], np.sin(turn)[part]
        rays = self._rays.reshape(-1, 3)[ray]
        towards = np.stack(
            [cos * rays[:, 0] + sin * rays[:, 1], cos * rays[:, 1] - sin * rays[:, 0], rays[:, 2]],
            axis=1,
        )
        towards = np.where(np.abs(towards) < 1e-9, 1e-9, towards)
        middle = np.stack(
            [
                np.cos(turn) * x + np.sin(turn) * y,
                np.cos(turn) * y - np.sin(turn) * x,
                z,
            ],
            axis=1,
        )
        # Slab test (Kay and Kajiya, 1986): a ray is in the box while it is in all three slabs.
        low = (middle - halves)[part] / towards
        high = (middle + halves)[part] / towards
        enter = np.minimum(low, high).max(axis=1)
        leave = np.maximum(low, high).min(axis=1)
        hits = np.flatnonzero((enter <= leave) & (enter > 0))
        return (
            ray[hits],
            enter[hits].astype(np.float32),
            bodies.owner[picked][part[hits]],
        )

    def _candidates(
        self, x: Floats, y: Floats, z: Floats, away: Floats, radius: Floats, half_height: Floats
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pairs (part, ray) that may meet: the ray crosses the part's bounding cylinder."""
        rings = len(self._elevations)
        near, far = np.maximum(away - radius, 0.05), away + radius
        top, bottom = z + half_height, z - half_height
        highest = np.arctan2(top, np.where(top > 0, near, far))
        lowest = np.arctan2(bottom, np.where(bottom < 0, near, far))
        first = np.searchsorted(self._elevations, lowest - 1e-6)
        rows = np.searchsorted(self._elevations, highest + 1e-6) - first
        width = np.where(away > radius, np.arcsin(np.minimum(radius / away, 1.0)), np.pi)
        step = TWO_PI / self._columns
        middle = np.arctan2(y, x)
        start = np.ceil((middle - width) / step).astype(np.int64)
        columns = np.minimum(
            np.floor((middle + width) / step).astype(np.int64) - start + 1, self._columns
        )
        sizes = np.clip(rows, 0, rings) * np.maximum(columns, 0)
        part = np.repeat(np.arange(len(x)), sizes)
        rank = np.arange(len(part)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        row, column = np.divmod(rank, columns[part])
        return part, (first[part] + row) * self._columns + (start[part] + column) % self._columns


def _open3d() -> Any:
    """Open3D, imported when the first ray is cast: it takes a second.

    Raises WorldError when a library that it needs is missing.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise WorldError(
            f"the simulated factory needs Open3D, which cannot be loaded: {error}; "
            "pip install 'coadapt-edge[open3d]' brings it, and on Debian it needs libegl1, libgl1, "
            "libgomp1, libusb-1.0-0 and libx11-6"
        ) from error
    return open3d
