"""A file of a bag: which topics it holds, when its messages were recorded, and their bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Place = tuple[int, int]
"""Where a message lies, in the file's own terms."""


class Index:
    """The messages of one topic in one file, in the order of the file."""

    def __init__(self, times_ns: NDArray[np.int64], places: NDArray[np.int64]) -> None:
        """`times_ns` (N,): when each was recorded; `places` (N, 2): a `Place` each."""
        self.times_ns = times_ns
        self.places = places

    def __len__(self) -> int:
        return len(self.times_ns)


def make_index(rows: list[tuple[int, int, int]]) -> Index:
    """An index of (time, place, place) rows."""
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return Index(table[:, 0], table[:, 1:])


class Storage(Protocol):
    """One file. Threads may share it. Methods raise WorldError when the file cannot be read."""

    path: Path
    topics: dict[str, str]
    """The type of each topic that has messages in CDR."""
    cut: str
    """Why the file ends early; empty when it is whole."""

    def index(self, topic: str) -> Index:
        """Where the messages of a topic lie; no message is read for it where that can be helped."""
        ...

    def read(self, place: Place, most: int | None = None) -> bytes:
        """The bytes of one message, at most the first `most`."""
        ...
