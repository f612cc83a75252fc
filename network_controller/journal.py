"""The journal of the controller: every action and why, one JSON line each.

A line is on the disk before the next action; a line that a crash tore is closed off, so that it
costs only itself. docs/network.md describes the fields.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec

from swarm.errors import JournalError


class Journal:
    """The writing end. A disk that refuses a line costs that line, and is counted in `lost`."""

    def __init__(self, path: Path) -> None:
        """Opens or makes the file. Raises JournalError when it cannot be written."""
        self.path = path
        self.lost = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            size = os.fstat(self._fd).st_size
            if size and os.pread(self._fd, 1, size - 1) != b"\n":
                os.write(self._fd, b"\n")
        except OSError as error:
            raise JournalError(f"journal {str(path)!r} cannot be written: {error}") from error

    def note(self, now_ns: int, action: str, reason: str, **facts: Any) -> None:
        """Appends one line: when, what was done, why, and facts that JSON can hold."""
        line = {"time_ns": now_ns, "action": action, **facts, "reason": reason}
        try:
            os.write(self._fd, msgspec.json.encode(line) + b"\n")
            os.fsync(self._fd)
        except OSError:
            self.lost += 1

    def close(self) -> None:
        """Closes the file."""
        os.close(self._fd)
