"""How requests for one algorithm to one robot ended, the newest first."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

MEMORY_FRAMES = 20.0
"""Frames of one robot and algorithm that are remembered: two seconds at 10 Hz, so that a decision
whose answers stay away loses its credit within two or three cycles."""
MOST_ANSWERS = round(MEMORY_FRAMES)
"""Each counts for one frame at least."""


class Told(NamedTuple):
    """How one request ended."""

    at_s: float
    asked_s: float
    answer_s: float
    """From the question to the whole answer; infinite where none came."""
    frames: float
    """Frames that waited for it."""
    encode_s: float | None
    """The robot's share of it; None without an answer."""
    work_s: float | None
    """The processor time of that."""
    capacity_bps: float
    """C(t) at that time."""
    at_least: bool
    """It took longer than `answer_s`, nobody knows how long: whether it would have met a later
    deadline is not known."""
    late: bool
    """It came after the deadline of its frame, or never."""


COLUMN = {name: place for place, name in enumerate(Told._fields)}
"""Of a row of `Series.table`."""


class Series:
    """The newest answers."""

    def __init__(self) -> None:
        self._rows = np.zeros((MOST_ANSWERS, len(COLUMN)))
        self._used = 0

    def __len__(self) -> int:
        return self._used

    @property
    def table(self) -> NDArray[np.float64]:
        """(MOST_ANSWERS, COLUMN): the newest first, with NaN for None and 0 or 1 for false or true;
        those from `len` on hold nothing. Not to be written to."""
        return self._rows

    def take(self, told: Told) -> None:
        """Adds one; the oldest goes where there are too many."""
        self._rows[1:] = self._rows[:-1]
        self._rows[0] = [math.nan if value is None else value for value in told]
        self._used = min(self._used + 1, MOST_ANSWERS)

    def newest(self) -> Told | None:
        """The one that ended last."""
        if not self._used:
            return None
        values = self._rows[0].tolist()
        row: dict[str, Any] = {
            name: None if math.isnan(value) else value
            for name, value in zip(COLUMN, values, strict=True)
        }
        return Told(**row | {name: row[name] > 0.0 for name in ("at_least", "late")})

    def forget(self, asked_from_s: float, asked_to_s: float) -> None:
        """Forgets what was asked between these times and came late."""
        rows = self._rows[: self._used]
        asked_s = rows[:, COLUMN["asked_s"]]
        gone = (rows[:, COLUMN["late"]] > 0.0) & (asked_from_s <= asked_s) & (asked_s <= asked_to_s)
        if gone.any():
            kept = rows[~gone]
            self._used = len(kept)
            self._rows[: self._used] = kept
