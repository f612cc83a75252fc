"""`describe`: one function over the methods of the Scene Abstraction Module."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from perception.scene import fast, reference
from perception.scene.segmentation import Groups, Segmentation
from perception.types import Scene, SceneObject, clean_points
from swarm.errors import PerceptionError
from swarm.geometry import Points

OWN_BODY_M = 2.1
"""Objects with their centroid this close to the sensor, seen from above, are the robot's own body
(interpret_pointcloud.py of the published code)."""
MIN_SIDE_M = 0.1
"""Sides count at least this much in the volume that density refers to: flat boxes exist."""

METHODS: Mapping[str, Callable[[Points], Segmentation]] = MappingProxyType(
    {"fast": fast.segment, "reference": reference.segment}
)


def segment(points: NDArray[np.floating], method: str = "fast") -> Segmentation:
    """Ground and objects of a cloud (N, 3) in the sensor's frame (z up), metres.

    The robot's own body is still among the objects. NaN and infinite points are left out.
    Raises ScanError for another shape and PerceptionError for an unknown method.
    """
    if method not in METHODS:
        raise PerceptionError(f"scene method {method!r} is unknown; allowed: {sorted(METHODS)}")
    return METHODS[method](clean_points(points))


def ground_mask(points: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Which points of a cloud (N, 3) are ground after method `fast`: bool (N,), False for NaN.

    Raises ScanError for another shape.
    """
    finite = clean_points(points)
    ground = fast.ground(finite)
    if len(finite) == len(points):
        return ground
    mask = np.zeros(len(points), dtype=np.bool_)
    mask[np.isfinite(np.asarray(points, dtype=np.float32)).all(axis=1)] = ground
    return mask


def describe(
    points: NDArray[np.floating], method: str = "fast", own_body_m: float = OWN_BODY_M
) -> Scene:
    """The objects in a scan, with the frame's own axes: centroid, distance, size, points, density.

    points: (N, 3) metres in the sensor's frame, z up. `centroid` is the mean of the object's
    points, `distance` the Euclidean (3-D) distance from the sensor to it, as in the published
    code, `size` the axis-aligned extent, `density` points per cubic metre of that extent, each
    side taken as at least MIN_SIDE_M. Objects with their centroid within `own_body_m` of the
    sensor are left out as the robot's own body; 0 keeps them. NaN and infinite points are left
    out. Method `fast` looks up to 120 m along x and y, `reference` everywhere.

    >>> from worlds.registry import open_world
    >>> scan = open_world("factory", robots=2, rings=16).scan("R1", 0)
    >>> scene = describe(scan.points)
    >>> nearest = min(scene.objects, key=lambda one: one.distance)
    >>> OWN_BODY_M < nearest.distance < 10.0
    True

    Raises ScanError when points are not (N, 3), PerceptionError for an unknown method.
    """
    found = segment(points, method)
    return Scene(_objects(found, own_body_m), int(np.count_nonzero(found.ground)))


def own_body(found: Segmentation, own_body_m: float = OWN_BODY_M) -> NDArray[np.bool_]:
    """Which objects of a segmentation are the robot's own body: bool (count,)."""
    members = found.points.take(found.members, axis=0)
    sizes = np.bincount(found.labels, minlength=found.count)
    x, y = (np.bincount(found.labels, members[:, i], found.count) / sizes for i in (0, 1))
    own: NDArray[np.bool_] = np.hypot(x, y) <= own_body_m
    return own


def _objects(found: Segmentation, own_body_m: float) -> tuple[SceneObject, ...]:
    if not found.count:
        return ()
    groups = Groups.of(found.labels, found.count)
    columns = np.ascontiguousarray(found.points.take(found.members[groups.order], axis=0).T)
    counts = np.diff(groups.starts, append=len(found.members))
    # Sums in float64: thousands of float32 terms would cost centimetres far from the origin.
    centroids = np.add.reduceat(columns, groups.starts, axis=1, dtype=np.float64) / counts
    sizes = np.maximum.reduceat(columns, groups.starts, axis=1).astype(np.float64)
    sizes -= np.minimum.reduceat(columns, groups.starts, axis=1)
    densities = counts / np.maximum(sizes, MIN_SIDE_M).prod(axis=0)
    distances = np.sqrt((centroids**2).sum(axis=0))
    others = np.hypot(centroids[0], centroids[1]) > own_body_m
    rows = zip(
        zip(*centroids[:, others].tolist(), strict=True),
        distances[others].tolist(),
        zip(*sizes[:, others].tolist(), strict=True),
        counts[others].tolist(),
        densities[others].tolist(),
        strict=True,
    )
    return tuple(SceneObject(*row) for row in rows)
