"""The file that a recording is written to."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import BinaryIO

from swarm.errors import RecordingError

MIN_FREE_BYTES = 64 << 20
"""A recording ends before the disk is full, so that its index still fits."""


class Sink:
    """A new file that knows its size, and remembers why it could not be written.

    The SDK only logs what fails in `write`, so whoever records has to look at `error`.
    """

    def __init__(self, path: Path) -> None:
        """Makes the file. Raises RecordingError when it is there already or cannot be made."""
        self.path = path
        self.bytes = 0
        """Size of the file."""
        self._at = 0
        self.error = ""
        """Empty while all is well."""
        if path.exists():
            raise RecordingError(f"{path} is there already; give another name")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Nobody else's file either that was made in between.
            self._file: BinaryIO = path.open("xb")
        except OSError as error:
            raise RecordingError(f"recording {path} cannot be written: {error}") from error
        if (why := self.nearly_full()) is not None:
            self.discard()
            raise RecordingError(f"recording {path} cannot be written: {why}")

    def nearly_full(self) -> str | None:
        """Why nothing more should be written; None while there is room."""
        try:
            free = shutil.disk_usage(self.path.parent).free
        except OSError as error:
            return f"its folder is gone: {error}"
        if free >= MIN_FREE_BYTES:
            return None
        return f"the disk has {free >> 20} MB left, {MIN_FREE_BYTES >> 20} MB are kept free"

    def write(self, data: bytes | bytearray) -> int:
        """Called by the SDK."""
        try:
            written = self._file.write(data)
        except OSError as error:
            self.error = self.error or str(error)
            raise
        self._at += written
        self.bytes = max(self.bytes, self._at)
        return written

    def seek(self, offset: int, whence: int = 0) -> int:
        """Called by the SDK, to go back to a chunk's head."""
        self._at = self._file.seek(offset, whence)
        return self._at

    def flush(self) -> None:
        """Called by the SDK."""
        self._file.flush()

    def close(self) -> None:
        """Ends the file; the reason why it could not be is then in `error`."""
        try:
            self._file.close()
        except OSError as error:
            self.error = self.error or str(error)

    def discard(self) -> None:
        """Removes the file: nothing was recorded."""
        self.close()
        self.path.unlink(missing_ok=True)
