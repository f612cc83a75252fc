"""One scan, whatever it comes as: a file of points, an array, or a list of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from perception.types import clean_points
from swarm.errors import ScanError, WorldError
from swarm.geometry import Points
from worlds.bounded import read_whole
from worlds.clouds.npy import read_npy
from worlds.clouds.pcd import MAX_POINTS, read_pcd
from worlds.clouds.ply import read_ply

KITTI_NUMBERS, NUSCENES_NUMBERS = 4, 5
"""float32 numbers a point: x, y, z and intensity; in `.pcd.bin` also the ring."""


def read_scan(source: Path | str | ArrayLike) -> Points:
    """The points of a scan: float32 (N, 3), metres, in the sensor's frame as stored.

    `source` is a file (.pcd, .ply, .bin as KITTI has it, .pcd.bin as nuScenes has it, .npy), an
    array (N, 3) or (N, 4), whose fourth column is left out, an array with the fields x, y and z,
    or a list of points. What is no point is left out: points that are not finite, or at the very
    origin, where sensors put rays without return.

    >>> read_scan([[1, 2, 3], [4, 5, 6], [0, 0, 0]]).shape
    (2, 3)

    Raises WorldError that names the file and what is wrong with it, and ScanError for an array or
    list that is no cloud.
    """
    if isinstance(source, (str, Path)):
        points = _read_file(Path(source))
    else:
        try:
            points = xyz(source)
        except ScanError as error:
            raise ScanError(f"this scan {error}") from error
    points = clean_points(points)
    returned = points.any(axis=1)
    return points if returned.all() else points.compress(returned, axis=0)


def is_scan(path: Path) -> bool:
    """Whether a file's name says that it holds a scan which `read_scan` reads."""
    return path.suffix.lower() in READERS


def xyz(source: ArrayLike) -> Points:
    """The first three columns, or the fields x, y and z, as float32 (N, 3).

    Raises ScanError, whose text lacks its subject.
    """
    try:
        values: NDArray[Any] = np.asarray(source)
        names = values.dtype.names
        if names is not None:
            if not {"x", "y", "z"} <= set(names):
                raise ScanError(f"has fields {list(names)}; x, y and z are needed")
            if values.size > MAX_POINTS:
                raise ScanError(f"has {values.size} points; at most {MAX_POINTS} are read")
            values = np.stack([values[name] for name in "xyz"], axis=-1)
        if values.shape == (0,):
            values = values.reshape(0, 3)
        if values.dtype.kind not in "fiub":
            raise ScanError(f"is of {values.dtype}; numbers are needed")
    except ValueError as error:  # rows of several lengths
        raise ScanError(f"is no table of numbers: {error}") from error
    if values.ndim != 2 or values.shape[1] not in (3, 4):
        raise ScanError(
            f"has shape {values.shape}; allowed: (N, 3), x y z a point, or (N, 4), with intensity"
        )
    if len(values) > MAX_POINTS:
        raise ScanError(f"has {len(values)} points; at most {MAX_POINTS} are read")
    with np.errstate(over="ignore"):  # a number beyond float32 becomes infinite
        return np.ascontiguousarray(values[:, :3], dtype=np.float32)


def _read_file(path: Path) -> Points:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise WorldError(f"scan {path} is a file of no known kind; allowed: {', '.join(READERS)}")
    return reader(path)


def _read_npy(path: Path) -> Points:
    try:
        return xyz(read_npy(path))
    except (OSError, ValueError) as error:
        raise WorldError(f"point cloud {path} cannot be read: {error}") from error
    except ScanError as error:
        raise WorldError(f"point cloud {path} {error}") from error


def _read_bin(path: Path) -> Points:
    """float32 numbers without header, little-endian."""
    width = NUSCENES_NUMBERS if path.name.lower().endswith(".pcd.bin") else KITTI_NUMBERS
    try:
        data = read_whole(path)
    except OSError as error:
        raise WorldError(f"point cloud {path} cannot be read: {error}") from error
    count, rest = divmod(len(data), 4 * width)
    if rest or count > MAX_POINTS:
        raise WorldError(
            f"point cloud {path} holds {len(data)} bytes; it must be {4 * width} bytes a point "
            f"(float32 x, y, z, intensity{', ring' if width == NUSCENES_NUMBERS else ''}), at most "
            f"{MAX_POINTS} points; other tables can be stored as .npy"
        )
    values = np.frombuffer(data, dtype="<f4").reshape(count, width)
    if (values[:, 3] < 0).any():
        raise WorldError(
            f"point cloud {path} has negative numbers in the place of the intensity: its points "
            f"are not float32 x, y, z, intensity; other tables can be stored as .npy, (N, 3)"
        )
    return np.ascontiguousarray(values[:, :3], dtype=np.float32)


READERS: dict[str, Callable[[Path], Points]] = {
    ".pcd": read_pcd,
    ".bin": _read_bin,
    ".ply": read_ply,
    ".npy": _read_npy,
}
