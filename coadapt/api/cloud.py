"""A scan in a script's hands, and everything that may stand for one."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm.errors import ScanError
from swarm.geometry import Matrix, Points, Pose, are_rotations, pose_of
from worlds.base import Scan
from worlds.scans import read_scan

LAST_ROW_ERROR = 1e-3
"""How far numbers of a pose's last row may be off."""


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Cloud:
    """One scan. NumPy takes it for its points: `np.asarray(cloud)`."""

    points: Points
    """float32 (N, 3), metres, in the sensor's frame: x forward, y left, z up."""
    pose: Matrix | None = field(default=None)
    """`world_from_sensor`, float64 (4, 4); None where nobody has said it."""
    name: str = ""
    """Of the robot or file."""

    def __len__(self) -> int:
        return len(self.points)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.points, dtype=dtype, copy=copy)

    def __repr__(self) -> str:
        name = f"{self.name}: " if self.name else ""
        reach = np.linalg.norm(self.points, axis=1).max(initial=0.0)
        where = "no pose"
        if self.pose is not None:
            pose = pose_of(self.pose)
            where = f"at ({pose.x:.2f}, {pose.y:.2f}, {pose.z:.2f}) m, yaw {pose.yaw:.2f} rad"
        return f"Cloud({name}{len(self)} points up to {reach:.1f} m away, {where})"


PoseLike = Pose | ArrayLike
"""Where a sensor is: a `Pose`, (x, y, z, roll, pitch, yaw), or a (4, 4) world_from_sensor."""
ScanLike = Cloud | Scan | Path | str | ArrayLike
"""What is taken for a scan: what `coadapt.scan` returns or reads, and a world's scan."""


def as_cloud(source: ScanLike, pose: PoseLike | None = None) -> Cloud:
    """Anything that stands for a scan; `pose` goes before one that it has.

    Raises WorldError for a file, and ScanError for anything else that is no scan or pose.
    """
    world_from_sensor = None if pose is None else as_matrix(pose)
    if isinstance(source, Cloud):
        kept = source.pose if world_from_sensor is None else world_from_sensor
        return Cloud(source.points, kept, source.name)
    if isinstance(source, Scan):
        kept = source.pose.matrix() if world_from_sensor is None else world_from_sensor
        return Cloud(source.points, kept, source.robot)
    name = Path(source).name if isinstance(source, (str, Path)) else ""
    return Cloud(read_scan(source), world_from_sensor, name)


def as_matrix(pose: PoseLike) -> Matrix:
    """`world_from_sensor`, float64 (4, 4), of a pose in any form.

    Raises ScanError for what is none: another shape, numbers that are not finite, or a matrix that
    scales, shears or mirrors.
    """
    if isinstance(pose, Pose):
        pose = pose.as_tuple()
    try:
        values = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ScanError(f"a pose must be numbers: {error}") from error
    if not np.isfinite(values).all():
        raise ScanError("a pose has numbers that are not finite")
    if values.shape == (6,):
        return Pose(*values.tolist()).matrix()
    if values.shape != (4, 4):
        raise ScanError(
            f"a pose of shape {values.shape} is none; allowed: a Pose, (x, y, z, roll, pitch, yaw) "
            "in metres and radians, or a (4, 4) matrix world_from_sensor"
        )
    if not are_rotations(values[:3, :3]):
        raise ScanError(
            "a pose's matrix is no rotation: it scales, shears or mirrors (frames are right-handed)"
        )
    if np.abs(values[3] - [0.0, 0.0, 0.0, 1.0]).max() > LAST_ROW_ERROR:
        raise ScanError(f"a pose's last row is {values[3].tolist()}; it must be 0, 0, 0, 1")
    return values
