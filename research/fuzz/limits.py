"""What an input may cost, and how that is measured."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

HANG_CPU_S = 1.0
"""Of the processor, not of the clock: another process that is busy makes no input slow."""
JUMP_MB = 100.0

_MEMORY = Path("/dev/shm")
_STATUS = Path("/proc/self/status")
_RESET = Path("/proc/self/clear_refs")


@contextmanager
def scratch() -> Iterator[dict[str, str]]:
    """The environment of a process that may end at once: its temporary files are removed for it.
    They lie in memory where the machine has a place for that."""
    place = _MEMORY if os.access(_MEMORY, os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="coadapt-fuzz-", dir=place) as folder:
        yield {**os.environ, "TMPDIR": folder}


def forget_peak() -> None:
    """Lets the peak of memory count anew from what is held now, where the kernel allows it."""
    with suppress(OSError):
        _RESET.write_text("5")


def peak_mb() -> float:
    """The most memory that this process has held, MB."""
    return _megabytes("VmHWM:")


def held_mb() -> float:
    """The memory that this process holds, MB."""
    return _megabytes("VmRSS:")


def _megabytes(name: str) -> float:
    line = next(line for line in _STATUS.read_text().splitlines() if line.startswith(name))
    return int(line.split()[1]) / 1024
