"""How far a robot sees free ground around itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perception.kernels.library import places, pointer
from perception.scene.description import OWN_BODY_M, own_body, segment
from perception.scene.segmentation import Groups
from swarm.errors import PerceptionError
from swarm.geometry import TWO_PI, Points

RAYS = 360
"""Azimuth steps in a turn: about 1 degree, wider than the step of any spinning LiDAR in use."""


def visible_range(
    points: NDArray[np.floating],
    sectors: int = 72,
    yaw: float = 0.0,
    own_body_m: float = OWN_BODY_M,
) -> NDArray[np.float32]:
    """How far free ground is seen in each of `sectors` equal azimuth sectors, metres.

    points: (N, 3) metres in the sensor's frame, z up. Sector k spans azimuths from k to k + 1
    times 2 pi / sectors, counter-clockwise from the sensor's x axis turned by -yaw: with the
    sensor's heading as `yaw`, from the world's x axis (roll and pitch are taken as small).

    A sector is divided into rays of about 1 degree. A ray ends at the nearest point of an object of
    the `fast` method (the own body apart); where it meets none, at its farthest ground return;
    where it has neither, at 0, as nothing is known there. The sector's value is the root of the
    mean square over its rays, so that a circular sector of this radius has the area that was seen.

    Returns float32 (sectors,). Raises ScanError when points are not (N, 3) and PerceptionError for
    a number of sectors that is not between 1 and 360.
    """
    if not 1 <= sectors <= RAYS:
        raise PerceptionError(f"{sectors} sectors cannot be had; allowed: 1 to {RAYS}")
    found = segment(points)
    rays = sectors * (RAYS // sectors)
    kept = ~own_body(found, own_body_m)
    turn = np.float32(math.remainder(yaw, TWO_PI))

    reach = np.zeros(rays, dtype=np.float32)
    ground = _ends(found.points, np.flatnonzero(found.ground), rays, turn, farthest=True)
    if len(ground):
        groups = Groups.of(_ray_of(ground, rays, turn), rays)
        reach[groups.keys] = groups.maximum(np.hypot(ground[:, 0], ground[:, 1]))
    obstacles = found.members.compress(kept[found.labels])
    standing = _ends(found.points, obstacles, rays, turn, farthest=False)
    if len(standing):
        groups = Groups.of(_ray_of(standing, rays, turn), rays)
        reach[groups.keys] = groups.minimum(np.hypot(standing[:, 0], standing[:, 1]))
    squares = (reach**2).reshape(sectors, -1)
    seen: NDArray[np.float32] = np.sqrt(squares.mean(axis=1))
    return seen


def _ends(
    points: Points, index: NDArray[np.intp], rays: int, turn: np.float32, farthest: bool
) -> Points:
    """Of points (N, 3) those at `index` that can end a ray, and others: all of them without the
    compiled loops. Which they are is decided by few exact azimuths instead of all."""
    compiled = places()
    if compiled is None:
        return points.take(index, axis=0)
    points = np.ascontiguousarray(points)
    chosen = np.empty(len(index) + rays, dtype=np.int64)
    square, best = np.empty(rays), np.empty(rays, dtype=np.int64)
    count = compiled.ray_ends(
        *(
            pointer(points),
            pointer(index),
            len(index),
            float(turn),
            rays / TWO_PI,
            rays,
            int(farthest),
        ),
        *(pointer(square), pointer(best), pointer(chosen)),
    )
    return points.take(chosen[:count], axis=0)


def _ray_of(points: Points, rays: int, turn: np.float32) -> NDArray[np.int32]:
    azimuth = np.arctan2(points[:, 1], points[:, 0]) + turn
    indices: NDArray[np.int32] = np.floor(azimuth * np.float32(rays / TWO_PI)).astype(np.int32)
    return indices % np.int32(rays)
