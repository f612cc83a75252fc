"""The journal of the controller: every action and why, one JSON line each.

A line is on the disk before the next action; a line that a crash tore is closed off, so that it
costs only itself. A full file becomes a part (swarm/line_file.py). docs/network.md describes the
fields.
"""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from swarm.errors import JournalError
from swarm.line_file import PART_BYTES, PARTS, LineFile

MAX_PENDING = 10_000
"""Lines kept in memory while the disk refuses them; the oldest go first."""


class Journal:
    """The writing end. Lines that a disk refuses wait in memory for the next one."""

    def __init__(self, path: Path, *, part_bytes: int = PART_BYTES, parts: int = PARTS) -> None:
        """Opens or makes the file. Raises JournalError when it cannot be written, or another
        process writes it."""
        self.path = path
        self.lost = 0
        """Lines that were given up because the disk refused too many."""
        self._pending: deque[bytes] = deque()
        try:
            self._file = LineFile(path, part_bytes=part_bytes, parts=parts)
        except OSError as error:
            raise JournalError(f"journal {str(path)!r} cannot be written: {error}") from error
        try:
            size = path.stat().st_size
            self._file.keep(size)
            if size and not _ends_a_line(path, size):
                self._file.append(b"\n")
        except OSError as error:
            self._file.close()
            raise JournalError(f"journal {str(path)!r} cannot be written: {error}") from error

    @property
    def pending(self) -> int:
        """Lines that wait for a disk that refused them."""
        return len(self._pending)

    def note(self, now_ns: int, action: str, reason: str, **facts: Any) -> None:
        """Appends one line: when, what was done, why, and facts that JSON can hold."""
        line = {"time_ns": now_ns, "action": action, **facts, "reason": reason}
        self._pending.append(msgspec.json.encode(line) + b"\n")
        if len(self._pending) > MAX_PENDING:
            self._pending.popleft()
            self.lost += 1
        self.retry()

    def retry(self) -> None:
        """Writes what waits, if the disk takes it now."""
        if not self._pending:
            return
        try:
            if self._file.is_full:
                # The lines matter more than the size of the file.
                with suppress(OSError):
                    self._file.rotate()
            self._file.append(b"".join(self._pending))
        except OSError:
            return
        self._pending.clear()

    def close(self) -> None:
        """Writes what waits, if the disk takes it, and closes the file."""
        self.retry()
        self._file.close()


def _ends_a_line(path: Path, size: int) -> bool:
    with open(path, "rb") as file:
        file.seek(size - 1)
        return file.read(1) == b"\n"
