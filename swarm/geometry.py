"""Rigid transforms between the world frame and robot frames.

Frames are right-handed: world x east, y north, z up; sensor x forward, y left, z up.
Angles are radians. A transform `a_from_b` is a 4x4 float64 matrix that maps coordinates in b
to coordinates in a.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Points = NDArray[np.float32]

TWO_PI = 2.0 * math.pi
ROTATION_ERROR = 1e-3
"""How far numbers of a rotation, squared, may be off: more than text with four digits loses."""


def wrap_heading(angle: float) -> float:
    """The angle in [0, 2 pi)."""
    wrapped = math.fmod(angle, TWO_PI)
    if wrapped < 0.0:
        wrapped += TWO_PI
    return 0.0 if wrapped >= TWO_PI else wrapped


@dataclass(frozen=True, slots=True)
class Pose:
    """A sensor's or robot's place in the world: metres, and radians about z, y, x (yaw last to
    first: R = Rz(yaw) Ry(pitch) Rx(roll))."""

    x: float
    y: float
    z: float
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    @property
    def heading(self) -> float:
        """Yaw in [0, 2 pi)."""
        return wrap_heading(self.yaw)

    def matrix(self) -> Matrix:
        """`world_from_here`, a 4x4 float64 matrix."""
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        cp, sp = math.cos(self.pitch), math.sin(self.pitch)
        cy, sy = math.cos(self.yaw), math.sin(self.yaw)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, self.x],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, self.y],
                [-sp, cp * sr, cp * cr, self.z],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )

    def as_tuple(self) -> tuple[float, float, float, float, float, float]:
        """(x, y, z, roll, pitch, yaw), as it travels in messages."""
        return (self.x, self.y, self.z, self.roll, self.pitch, self.yaw)

    def distance_to(self, other: Pose) -> float:
        """Distance in the ground plane, metres."""
        return math.hypot(self.x - other.x, self.y - other.y)


def are_rotations(matrices: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Of matrices (..., 3, 3), whether each is a rotation: finite, without scale, shear or mirror,
    up to ROTATION_ERROR. Bool (...).

    >>> are_rotations(np.array([np.eye(3), -np.eye(3), 2 * np.eye(3)])).tolist()
    [True, False, False]
    """
    finite = np.isfinite(matrices).all(axis=(-2, -1))
    known = np.where(finite[..., None, None], matrices, 0.0)
    off = np.abs(known @ np.swapaxes(known, -2, -1) - np.eye(3)).max(axis=(-2, -1))
    return np.asarray(finite & (off < ROTATION_ERROR) & (np.linalg.det(known) > 0))


def invert(a_from_b: Matrix) -> Matrix:
    """`b_from_a` of a rigid 4x4 transform."""
    rotation = a_from_b[:3, :3]
    out = np.eye(4)
    out[:3, :3] = rotation.T
    out[:3, 3] = -rotation.T @ a_from_b[:3, 3]
    return out


def transform(a_from_b: Matrix, points_b: NDArray[np.floating]) -> Points:
    """Points (N, 3) given in b, as float32 (N, 3) in a.

    >>> robot = Pose(10.0, 0.0, 0.0, yaw=math.pi / 2)
    >>> transform(robot.matrix(), np.array([[2.0, 0.0, 1.0]])).round(3).tolist()
    [[10.0, 2.0, 1.0]]
    """
    rotation = a_from_b[:3, :3].astype(np.float32)
    offset = a_from_b[:3, 3].astype(np.float32)
    return np.asarray(points_b, dtype=np.float32) @ rotation.T + offset


def yaw_of(a_from_b: Matrix) -> float:
    """The heading of b's x axis seen in a's ground plane, radians in [0, 2 pi)."""
    return wrap_heading(math.atan2(float(a_from_b[1, 0]), float(a_from_b[0, 0])))


def pose_of(world_from_here: Matrix) -> Pose:
    """The pose whose `matrix()` is the given one; yaw in (-pi, pi]."""
    m = world_from_here
    return Pose(
        float(m[0, 3]),
        float(m[1, 3]),
        float(m[2, 3]),
        roll=math.atan2(float(m[2, 1]), float(m[2, 2])),
        pitch=math.asin(min(1.0, max(-1.0, -float(m[2, 0])))),
        yaw=math.atan2(float(m[1, 0]), float(m[0, 0])),
    )
