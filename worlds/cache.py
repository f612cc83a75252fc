"""Scans kept on disk between runs, one file each."""

from __future__ import annotations

import contextlib
import io
import os
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarm.files import write_whole

MAX_FILES = 2000
"""About 1 GB at 32 rings."""
_CHECKSUM_BYTES = 4


class ScanCache:
    """A directory of scans: `.npy` with a point a row, float32, then a CRC-32.

    A directory that holds `max_files` takes no more: a world that runs through its frames again
    and again would otherwise push out each scan just before it is wanted. Processes may share the
    directory. A file that cannot be used counts as missing, a write that fails is left undone:
    the scan can always be computed.
    """

    def __init__(self, directory: Path, max_files: int = MAX_FILES) -> None:
        self._directory = Path(directory)
        self._max_files = max_files
        self._full = False
        """It was once: nothing is ever taken out."""

    def read(self, name: str, columns: int) -> NDArray[np.float32] | None:
        """The rows of that scan, float32 (N, columns), or None."""
        try:
            data = (self._directory / f"{name}.npy").read_bytes()
            body, checksum = data[:-_CHECKSUM_BYTES], data[-_CHECKSUM_BYTES:]
            if zlib.crc32(body).to_bytes(_CHECKSUM_BYTES, "little") != checksum:
                return None
            rows = np.load(io.BytesIO(body), allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        if rows.dtype != np.float32 or rows.ndim != 2 or rows.shape[1] != columns:
            return None
        return np.asarray(rows, dtype=np.float32)

    def write(self, name: str, rows: NDArray[np.float32]) -> None:
        """Keeps a scan, (N, columns), if there is room, or in place of the file of that name."""
        with contextlib.suppress(OSError):
            target = self._directory / f"{name}.npy"
            if not self._has_room_for(target):
                return
            buffer = io.BytesIO()
            np.save(buffer, rows, allow_pickle=False)
            body = buffer.getvalue()
            write_whole(target, body + zlib.crc32(body).to_bytes(_CHECKSUM_BYTES, "little"))

    def _has_room_for(self, target: Path) -> bool:
        if target.exists():
            return True
        # Looking through a full directory would cost more than computing the scan.
        if not self._full:
            self._directory.mkdir(parents=True, exist_ok=True)
            self._full = len(os.listdir(self._directory)) >= self._max_files
        return not self._full
