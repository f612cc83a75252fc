"""File systems that are full."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from deploy.paths import JOURNAL, NET
from research.chaos.faults.base import Begin, End, Kind
from research.chaos.history import Fault
from research.chaos.stage import LOGS, Stage

FILLER = "filler"
BLOCK = bytes(1 << 20)


def fill(folder: Path) -> Path:
    """A file that takes all the room that is left, to the last byte. Raises OSError for another
    reason than that."""
    path = folder / FILLER
    with open(path, "wb", buffering=0) as file:
        for size in (len(BLOCK), 4096, 1):
            try:
                while file.write(BLOCK[:size]) == size:
                    pass
            except OSError as error:
                if error.errno != errno.ENOSPC:
                    raise
    return path


def _full(name: str) -> Begin:
    def begin(stage: Stage, fault: Fault) -> End:
        path = fill(stage.disk(name))

        def end() -> str:
            left = os.statvfs(path).f_bavail
            path.unlink()
            return f"{left} blocks were free in {name}/"

        return end

    return begin


FULL_S = (3.0, 6.0)
KINDS = (
    Kind("full-journal", _full(JOURNAL), FULL_S, "nobody", ("journal",)),
    Kind("full-state", _full(NET), FULL_S, "nobody", ("state",)),
    Kind("full-logs", _full(LOGS), FULL_S, "nobody", ("logs",)),
)
