"""Reads files that may announce more than they hold: room is made for what is there."""

from __future__ import annotations

import errno
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

MAX_FILE_BYTES = 1 << 30
"""Of a file that is read whole: the largest scan, written as text."""
_NPY_HEADERS = {
    (1, 0): (2, npy.read_array_header_1_0),
    (2, 0): (4, npy.read_array_header_2_0),
}
"""By version: how many bytes tell the header's length, and what reads the header."""
_MAX_NPY_HEADER_BYTES = 10_000


def read_whole(path: Path) -> bytes:
    """All bytes of a file. Raises OSError, also for a file that is too large."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > MAX_FILE_BYTES:
            raise OSError(errno.EFBIG, f"it has {size} bytes; allowed: {MAX_FILE_BYTES}")
        return file.read(MAX_FILE_BYTES)


def load_npy(path: Path) -> NDArray[Any]:
    """The array of an .npy file, not of pickled objects.

    Raises OSError, and ValueError for a file that is something else or ends before its array.
    """
    with path.open("rb") as file:
        version = npy.read_magic(file)
        if version not in _NPY_HEADERS:
            raise ValueError(f"it is of version {version}; allowed: 1.0 and 2.0")
        length, read = _NPY_HEADERS[version]
        begin = file.tell()
        header_bytes = int.from_bytes(file.read(length), "little")
        if header_bytes > _MAX_NPY_HEADER_BYTES:
            raise ValueError(
                f"its header has {header_bytes} bytes; allowed: {_MAX_NPY_HEADER_BYTES}"
            )
        file.seek(begin)
        shape, _, kind = read(file)
        announced = math.prod(shape) * kind.itemsize
        there = os.fstat(file.fileno()).st_size - file.tell()
    if announced > min(there, MAX_FILE_BYTES):
        raise ValueError(
            f"it announces an array of {announced} bytes; {there} are there, and "
            f"{MAX_FILE_BYTES} allowed"
        )
    found: NDArray[Any] = np.load(path, allow_pickle=False)
    return found
