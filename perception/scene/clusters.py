"""What in a scan may be an object: clusters that are no larger than one, and neither too low nor
too tall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.scene import fast
from perception.scene.segmentation import Groups
from swarm.geometry import Points

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ObjectLimits:
    """Of a cluster that may be an object, metres."""

    longest: float
    """Along the direction in which it is longest, seen from above: at most a body's diagonal."""
    low: float
    tall: float
    """Its highest point over the ground lies between these."""
    own_body: float
    """With its middle this near to the sensor it is the robot itself."""


def may_be_objects(
    points: Points, structure: NDArray[np.bool_], limits: ObjectLimits
) -> NDArray[np.bool_]:
    """Which of finite points, float32 (N, 3), sensor frame, z up, metres, belong to clusters that
    may be objects: bool (N,). What is `structure`, bool (N,), belongs to none and ends clusters.
    Nothing beyond the reach of `fast` belongs to one."""
    found = np.zeros(len(points), dtype=np.bool_)
    rest = np.flatnonzero(~structure & fast.in_range(points))
    cloud = points.take(rest, axis=0)
    height = fast.heights(cloud)
    members, labels, count = fast.objects(cloud, height)
    if not count:
        return found
    groups = Groups.of(labels, count)
    places = cloud.take(members, axis=0)[:, :2].astype(np.float64)
    middles = _means(places, labels, count)
    away = places - middles[labels]
    along = _directions(away, labels, count)[labels]
    spread = (away * along).sum(axis=1)
    top = groups.maximum(height[members])
    fits = groups.maximum(spread) - groups.minimum(spread) <= limits.longest
    fits &= (top >= limits.low) & (top <= limits.tall)
    fits &= np.hypot(*middles.T) > limits.own_body
    found[rest[members[fits[labels]]]] = True
    return found


def _means(values: Floats, labels: NDArray[np.int32], count: int) -> Floats:
    """Of values (K, 2), by label: (count, 2)."""
    sums = [np.bincount(labels, column, count) for column in values.T]
    return np.stack(sums, axis=1) / np.bincount(labels, minlength=count)[:, None]


def _directions(away: Floats, labels: NDArray[np.int32], count: int) -> Floats:
    """The principal axes of points (K, 2) about their groups' middles: unit vectors (count, 2)."""
    xx, yy = _means(away**2, labels, count).T
    xy = np.bincount(labels, away[:, 0] * away[:, 1], count) / np.bincount(labels, minlength=count)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
