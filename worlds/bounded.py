"""Reads files that may announce more than they hold: room is made for what is there."""

from __future__ import annotations

import errno
import os
from pathlib import Path

MAX_FILE_BYTES = 1 << 30
"""Of a file that is read whole: the largest scan, written as text."""


def read_whole(path: Path) -> bytes:
    """All bytes of a file. Raises OSError, also for a file that is too large."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > MAX_FILE_BYTES:
            raise OSError(errno.EFBIG, f"it has {size} bytes; allowed: {MAX_FILE_BYTES}")
        return file.read(MAX_FILE_BYTES)
