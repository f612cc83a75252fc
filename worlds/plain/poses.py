"""Where a sensor was, scan by scan: `poses.txt`, `poses.csv` or `poses.npy`."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm.errors import WorldError
from swarm.geometry import Matrix, Pose, are_rotations, invert
from worlds.clouds.npy import read_npy

NAMES = ("poses.txt", "poses.csv", "poses.npy")
CALIBRATION = "calib.txt"
"""KITTI's: its line `Tr` says where the LiDAR is in the frame of the camera that poses are of."""
ANGLES = ("roll", "pitch", "yaw")
QUATERNION = ("qx", "qy", "qz", "qw")


def find_poses(folder: Path) -> Path | None:
    """The file of a folder that has its poses. Raises WorldError where there are several."""
    found = [folder / name for name in NAMES if (folder / name).is_file()]
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise WorldError(f"{folder} has several files of poses: {names}; keep one")
    return found[0] if found else None


def read_poses(path: Path) -> list[Matrix]:
    """The poses of a file: float64 (4, 4) each, sensor to fixed frame, in the order of the scans.

    `poses.txt` has KITTI's rows of a 3 x 4 matrix, row by row; `poses.npy` an array (N, 4, 4),
    (N, 3, 4) or (N, 12) of the same, or (N, 6): x, y, z, roll, pitch, yaw; `poses.csv` columns
    x, y, z, and yaw, pitch, roll or qx, qy, qz, qw. Metres and radians.

    Raises WorldError that names the file, the row and what is wrong with it.
    """
    try:
        match path.suffix:
            case ".txt":
                matrices = _matrices(np.loadtxt(path, ndmin=2))
            case ".npy":
                matrices = _matrices(read_npy(path))
            case _:
                matrices = _from_csv(path)
    except (OSError, ValueError, csv.Error) as error:
        raise WorldError(f"poses {path} cannot be read: {error}") from error
    if matrices.size == 0:
        raise WorldError(f"poses {path} has none")
    right = np.isfinite(matrices).all(axis=(1, 2)) & are_rotations(matrices[:, :3, :3])
    if not right.all():
        raise WorldError(
            f"row {int(right.argmin()) + 1} of poses {path} is no pose: its 3 x 3 part must be a "
            "rotation, and all numbers finite"
        )
    if path.suffix == ".txt" and (path.parent / CALIBRATION).is_file():
        camera = _calibration(path.parent / CALIBRATION)
        return [invert(camera) @ matrix @ camera for matrix in matrices]
    return list(matrices)


def _matrices(values: NDArray[Any]) -> NDArray[np.float64]:
    """(N, 4, 4). Raises ValueError."""
    if values.dtype.kind not in "fiu":
        raise ValueError(f"it is of {values.dtype}; numbers are needed")
    shape = values.shape
    if values.size == 0:
        return np.zeros((0, 4, 4))
    if values.ndim == 2 and shape[1] == 6:
        return np.array([Pose(*map(float, row)).matrix() for row in values]).reshape(-1, 4, 4)
    if shape[1:] not in ((12,), (3, 4), (4, 4)):
        raise ValueError(
            f"it has shape {shape}; allowed: (N, 12), (N, 3, 4), (N, 4, 4), and (N, 6): x, y, z, "
            "roll, pitch, yaw"
        )
    out = np.tile(np.eye(4), (shape[0], 1, 1))
    out[:, :3] = values[:, :3] if shape[1:] == (4, 4) else values.reshape(-1, 3, 4)
    return out


def _from_csv(path: Path) -> NDArray[np.float64]:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))
    columns = list(rows[0]) if rows else []
    turned = QUATERNION if set(QUATERNION) <= set(columns) else ANGLES
    needed = ("x", "y", "z", *(QUATERNION if turned is QUATERNION else ("yaw",)))
    missing = [name for name in needed if name not in columns]
    if missing:
        raise ValueError(
            f"its first line has the columns {columns}; needed: x, y, z, and yaw (pitch, roll) "
            "or qx, qy, qz, qw"
        )
    out = []
    for number, row in enumerate(rows, 2):
        try:
            x, y, z = (float(row[name]) for name in "xyz")
            if turned is ANGLES:
                roll, pitch, yaw = (float(row.get(name, 0.0)) for name in ANGLES)
                matrix = Pose(x, y, z, roll, pitch, yaw).matrix()
            else:
                matrix = _turned(*(float(row[name]) for name in QUATERNION))
                matrix[:3, 3] = x, y, z
        except (TypeError, ValueError) as error:
            raise ValueError(f"line {number}: {error}") from error
        out.append(matrix)
    return np.array(out).reshape(-1, 4, 4)


def _turned(x: float, y: float, z: float, w: float) -> Matrix:
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not 0.9 < length < 1.1:
        raise ValueError(f"{(x, y, z, w)} is no unit quaternion")
    x, y, z, w = (part / length for part in (x, y, z, w))
    out = np.eye(4)
    out[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return out


def _calibration(path: Path) -> Matrix:
    """Camera from LiDAR."""
    try:
        for line in path.read_text().splitlines():
            name, _, numbers = line.partition(":")
            if name.strip() in ("Tr", "Tr_velo_to_cam", "Tr_velo_cam"):
                row = np.array([numbers.split()], dtype=np.float64)
                found: Matrix = _matrices(row)[0]
                return found
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise WorldError(f"calibration {path} cannot be read: {error}") from error
    raise WorldError(f"calibration {path} has no line Tr, where the LiDAR is in the camera's frame")
