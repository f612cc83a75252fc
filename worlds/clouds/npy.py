"""Arrays as NumPy stores them (.npy)."""

from __future__ import annotations

import math
import os
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO

from numpy.lib import format as npy
from numpy.typing import NDArray

from worlds.bounded import MAX_FILE_BYTES

_HEADERS = {
    (1, 0): (2, npy.read_array_header_1_0),
    (2, 0): (4, npy.read_array_header_2_0),
}
"""By version: how many bytes tell the header's length, and what reads the header."""
_MAX_HEADER_BYTES = 10_000
_OF_A_HEADER = (
    EOFError, IndexError, OverflowError, RecursionError, SyntaxError, TokenError, TypeError,
)  # fmt: skip
"""What NumPy lets through of the reader of Python's text that it reads a header with."""


def read_npy(path: Path) -> NDArray[Any]:
    """The array of a file. Pickles, whose stored text may run code, are refused, and so is a file
    that announces more than it holds.

    Raises OSError when it cannot be read, and ValueError that says what is wrong with its content.
    """
    try:
        with path.open("rb") as file:
            _check_size(file)
            file.seek(0)
            array: NDArray[Any] = npy.read_array(file, allow_pickle=False)
    except _OF_A_HEADER as error:
        raise ValueError(f"its header is malformed: {error}") from error
    except MemoryError as error:
        raise ValueError(f"it names more than there is memory for: {error}") from error
    return array


def _check_size(file: BinaryIO) -> None:
    version = npy.read_magic(file)
    if version not in _HEADERS:
        raise ValueError(f"it is of version {version}; allowed: 1.0 and 2.0")
    length, read = _HEADERS[version]
    begin = file.tell()
    header_bytes = int.from_bytes(file.read(length), "little")
    if header_bytes > _MAX_HEADER_BYTES:
        raise ValueError(f"its header has {header_bytes} bytes; allowed: {_MAX_HEADER_BYTES}")
    file.seek(begin)
    shape, _, kind = read(file)
    announced = math.prod(shape) * kind.itemsize
    there = os.fstat(file.fileno()).st_size - file.tell()
    if announced > min(there, MAX_FILE_BYTES):
        raise ValueError(
            f"it announces an array of {announced} bytes; {there} are there, and "
            f"{MAX_FILE_BYTES} allowed"
        )
