"""Which frame leads to which, and how a sensor on a base moves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from options.ros.messages import Odometry, Transform
from options.ros.track import MOST, Track
from swarm.geometry import Matrix

FIXED = ("map", "odom")
"""Frames that stay, by REP-105 (https://ros.org/reps/rep-0105.html), the better one first."""
BASE = "base_link"

Velocity = tuple[float, float, float]


def plain(frame: str) -> str:
    """A frame's name without the robot's prefix."""
    return frame.rsplit("/", 1)[-1]


def chain_down(parents: Mapping[str, str], frame: str) -> list[str] | None:
    """The frames from below a fixed frame down to a frame, each the child of the one before.

    `parents` gives the parent of each frame. None when no fixed frame leads there.
    """
    way = [frame]
    while way[-1] in parents and len(way) <= len(parents):
        way.append(parents[way[-1]])
    for fixed in FIXED:
        for at, name in enumerate(way):
            if plain(name) == fixed:
                return way[:at][::-1]
    return None


def mounted(static: Mapping[str, Transform], base: str, sensor: str) -> Matrix | None:
    """`base_from_sensor` by transforms that stay, each under its child; None when none lead there.

    Raises WorldError for one that is no transform.
    """
    out, frame = np.eye(4), sensor
    for _ in range(len(static) + 1):
        if frame == base:
            return out
        if frame not in static:
            return None
        one = static[frame]
        out = Track([one]).at(0).a_from_b @ out
        frame = one.parent
    return None


def sensor_velocity(twist: Odometry, fixed_from_base: Matrix, base_from_sensor: Matrix) -> Velocity:
    """Of a sensor on a base, m/s along the axes of the fixed frame; 0 for a twist that is none."""
    # A sensor beside the robot's axis moves with its turning, too.
    arm = base_from_sensor[:3, 3]
    moving = np.array(twist.linear) + np.cross(np.array(twist.angular), arm)
    if not (np.abs(moving) <= MOST).all():
        return (0.0, 0.0, 0.0)
    x, y, z = fixed_from_base[:3, :3] @ moving
    return (float(x), float(y), float(z))
