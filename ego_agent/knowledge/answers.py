"""How long one robot's answers with one algorithm take, and how likely they are in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

POOL_WEIGHT = 2.0
"""Frames that the other robots' answers count for beside a robot's own."""
PRIOR_WEIGHT = 0.5
"""Frames that the belief counts for that answers come in time."""


class Weighted(NamedTuple):
    """One answer's time, and the frames that it counts for by now."""

    answer_s: float
    frames: float
    at_least: bool


@dataclass(frozen=True, slots=True)
class Pool:
    """Answer times of all robots with one algorithm, as of a robot of usual speed."""

    times_s: NDArray[np.float64]
    """Rising."""
    known: NDArray[np.float64]
    """Frames of each time and all before it, of answers whose time is known."""
    open: NDArray[np.float64]
    """The same of those that took longer than told."""

    def within(self, limit_s: float) -> tuple[float, float]:
        """Frames whose answer took no longer, and all of which that is known."""
        at = int(np.searchsorted(self.times_s, limit_s, side="right"))
        hits, unclear = (self.known[at - 1], self.open[at - 1]) if at else (0.0, 0.0)
        return float(hits), float(self.known[-1] + self.open[-1] - unclear)


@dataclass(frozen=True, slots=True)
class AnswerTimes:
    """What is known of one robot's answers with one algorithm."""

    own: tuple[Weighted, ...] = ()
    """Its own answers; infinite seconds for those that never came."""
    pool: Pool | None = None
    slowness: float = 1.0
    """How many times longer than others' its answers take."""
    encode_s: float | None = None
    """Median of its own encoding times."""
    work_s: float | None = None
    """Median of its processor's time for that."""
    answer_s: float | None = None
    """Median from question to answer, of the answers that came."""
    frames: float = 0.0
    """Frames that its own evidence counts for."""

    @property
    def lost(self) -> float:
        """Share of its own frames whose answer never came; 0 without evidence."""
        never = sum(one.frames for one in self.own if one.answer_s == math.inf)
        return never / self.frames if self.own else 0.0

    @property
    def transfer_s(self) -> float | None:
        """What its answers take beside encoding: the way, and waiting for processors."""
        if self.answer_s is None or self.encode_s is None:
            return None
        return max(0.0, self.answer_s - self.encode_s)

    def in_time(self, deadline_s: float) -> float:
        """Probability that an answer comes within the deadline."""
        hits = total = PRIOR_WEIGHT
        for one in self.own:
            if one.answer_s > deadline_s:
                total += one.frames
            elif not one.at_least:
                hits += one.frames
                total += one.frames
        if self.pool is not None:
            within, known = self.pool.within(deadline_s / self.slowness)
            borrowed = min(POOL_WEIGHT, known)
            if known > 0.0:
                hits += borrowed * within / known
                total += borrowed
        return hits / total


UNTRIED = AnswerTimes()
"""Nothing is known: answers are taken to come in time."""
