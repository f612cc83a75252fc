"""Logs of processes that run for months: a full one becomes `<name>.log.1`, and so on."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

LOG_BYTES = 16_000_000
LOG_PARTS = 3
"""Full parts that are kept: with the one that is written, 64 MB a process at most, and what it
writes between two looks."""


def rotate_logs(folder: Path, *, log_bytes: int = LOG_BYTES, parts: int = LOG_PARTS) -> None:
    """Copies full logs to their newest part and empties them; who writes them goes on at their
    begin, as they are opened to append. A line that comes in between is lost.

    A log that cannot be copied is emptied all the same: a full disk needs it most. Never raises.
    """
    for log in folder.glob("*.log"):
        with suppress(OSError):
            if log.stat().st_size >= log_bytes:
                _rotate(log, parts)


def _rotate(log: Path, parts: int) -> None:
    for number in range(parts, 1, -1):
        with suppress(FileNotFoundError):
            _part(log, number - 1).replace(_part(log, number))
    try:
        shutil.copyfile(log, _part(log, 1))
    except OSError:
        _part(log, 1).unlink(missing_ok=True)
    with open(log, "r+b") as file:
        file.truncate()


def _part(log: Path, number: int) -> Path:
    return log.with_name(f"{log.name}.{number}")
