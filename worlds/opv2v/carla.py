"""Poses, points and boxes of CARLA (and of OPV2V, recorded in it) in our frames.

CARLA's frames are left-handed: y points right, yaw turns clockwise seen from above, and a positive
pitch lifts the nose. In ours y is negated, and so are yaw and pitch; roll keeps its sign.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from perception.types import Boxes
from swarm.geometry import Points, Pose, wrap_heading


def pose(x: float, y: float, z: float, roll: float, yaw: float, pitch: float) -> Pose:
    """A CARLA pose (metres, degrees; in OPV2V's order of angles).

    Raises ValueError for a number that is not finite.
    """
    if not all(map(math.isfinite, (x, y, z, roll, yaw, pitch))):
        raise ValueError(f"pose {(x, y, z, roll, yaw, pitch)} is not finite")
    return Pose(x, -y, z, math.radians(roll), -math.radians(pitch), -math.radians(yaw))


def points(stored: Points) -> Points:
    """Points (N, 3) of a CARLA sensor; read-only, so that they can be cached."""
    flipped = stored * np.array([1.0, -1.0, 1.0], dtype=np.float32)
    flipped.setflags(write=False)
    return flipped


def boxes(vehicles: list[dict[str, Any]]) -> Boxes:
    """Vehicles of an OPV2V frame description, score 1.

    `location` is the actor's origin, `center` the box's offset from it in the actor's frame,
    `extent` half sizes in metres, `angle` roll, yaw, pitch in degrees. Raises KeyError, TypeError,
    ValueError or IndexError for a malformed one.
    """
    if not vehicles:
        return Boxes.empty()
    centers, sizes, headings = [], [], []
    for vehicle in vehicles:
        actor = pose(*map(float, (*vehicle["location"], *vehicle["angle"])))
        x, y, z = map(float, vehicle["center"])
        centers.append((actor.matrix() @ np.array([x, -y, z, 1.0]))[:3])
        length, width, height = (2.0 * float(half) for half in vehicle["extent"])
        sizes.append((length, width, height))
        headings.append(wrap_heading(actor.yaw))
    return Boxes(
        centers=np.array(centers, dtype=np.float64),
        sizes=np.array(sizes, dtype=np.float64),
        headings=np.array(headings, dtype=np.float64),
        scores=np.ones(len(vehicles)),
        labels=("vehicle",) * len(vehicles),
    )
