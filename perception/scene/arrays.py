"""A scene as one array, the form in which it travels between robots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.types import Scene, SceneObject
from swarm.errors import ScanError
from swarm.geometry import Matrix

COLUMNS = (
    "centroid_x",
    "centroid_y",
    "centroid_z",
    "distance",
    "size_x",
    "size_y",
    "size_z",
    "points",
    "density",
)


def to_array(scene: Scene, world_from_sensor: Matrix) -> NDArray[np.float32]:
    """The objects in the world frame, float32 (N, 9) with the columns COLUMNS.

    Centroids are moved to the world frame. Distance (from the sensor), points and density stay as
    described. Sizes are those of the world-axis-aligned box around the turned box, |R| size: they
    never understate an object, and overstate a long one seen at 45 degrees by up to sqrt(2).
    """
    rows = [(*o.centroid, o.distance, *o.size, o.points, o.density) for o in scene.objects]
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(COLUMNS))
    rotation = world_from_sensor[:3, :3]
    table[:, :3] = table[:, :3] @ rotation.T + world_from_sensor[:3, 3]
    table[:, 4:7] = table[:, 4:7] @ np.abs(rotation).T
    return table.astype(np.float32)


def from_array(objects: NDArray[np.floating], ground_points: int = 0) -> Scene:
    """The scene that `to_array` wrote; centroids and sizes stay in the world frame.

    Raises ScanError when the array is not (N, 9).
    """
    if objects.ndim != 2 or objects.shape[1] != len(COLUMNS):
        raise ScanError(
            f"a scene array must have shape (N, {len(COLUMNS)}), this one has {objects.shape}"
        )
    return Scene(
        tuple(
            SceneObject((x, y, z), distance, (dx, dy, dz), int(points), density)
            for x, y, z, distance, dx, dy, dz, points, density in objects.tolist()
        ),
        ground_points,
    )
