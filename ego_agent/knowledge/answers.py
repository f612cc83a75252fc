"""How long one robot's answers with one algorithm take, and how likely they are in time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

POOL_WEIGHT = 2.0
"""Frames that the other robots' answers count for beside a robot's own."""
PRIOR_WEIGHT = 0.5
"""Frames that the belief counts for that answers come in time."""
ANOTHER_LINK = 2.0
"""A link that is more than this many times wider or narrower is another one."""
LITTLE = 0.2
"""Share of processor times that are shorter than the one that counts: whatever else runs, on that
core or beside it, only makes work longer."""


def little(times_s: Iterable[float]) -> float:
    """What work takes that took so long, when little else runs; of one time or more."""
    ranked = sorted(times_s)
    return ranked[int(LITTLE * len(ranked))]


class Weighted(NamedTuple):
    """One answer's time, and the frames that it counts for by now."""

    answer_s: float
    timely: float
    """Where it was in time."""
    late: float
    """Where it was late."""
    at_least: bool = False
    """Whether it took longer than told."""


def on_another_link(wider: float, *, configured: bool) -> tuple[float, float]:
    """What answers count for, in time and late, on a link that is so many times wider than theirs;
    `configured`: that is known, not guessed.

    What came in time comes in time over a wider link, too, and what was late is late over a
    narrower one; the reverse is less and less likely, the more the link has changed. A link that is
    known to be several times wider says nothing of what was late.
    """
    timely = min(1.0, ANOTHER_LINK * wider)
    if configured:
        return timely, min(1.0, max(0.0, 2.0 - wider / ANOTHER_LINK))
    return timely, min(1.0, ANOTHER_LINK / wider)


@dataclass(frozen=True, slots=True)
class Pool:
    """Answer times of all robots with one algorithm, as of a robot of usual speed."""

    times_s: NDArray[np.float64]
    """Rising."""
    timely: NDArray[np.float64]
    """Frames of each time and all before it that count where that is in time: answers whose time
    is known."""
    late: NDArray[np.float64]
    """The same that count where that is late, of all answers."""

    def within(self, limit_s: float) -> tuple[float, float]:
        """Frames whose answer took no longer, and all of which that is known. Of one that took
        longer than told it is not known where that is less than the limit."""
        at = int(np.searchsorted(self.times_s, limit_s, side="right"))
        hits, in_time = (self.timely[at - 1], self.late[at - 1]) if at else (0.0, 0.0)
        return float(hits), float(hits + self.late[-1] - in_time)


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
    """A low one (`little`) of the processor times of that."""
    answer_s: float | None = None
    """Median from question to answer, of the answers that came."""
    frames: float = 0.0
    """Frames that its own evidence counts for."""

    @property
    def lost(self) -> float:
        """Share of its own frames whose answer never came; 0 without evidence."""
        never = sum(one.late for one in self.own if one.answer_s == math.inf)
        return never / self.frames if self.frames > 0.0 else 0.0

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
                total += one.late
            elif not one.at_least:
                hits += one.timely
                total += one.timely
        if self.pool is not None:
            within, known = self.pool.within(deadline_s / self.slowness)
            borrowed = min(POOL_WEIGHT, known)
            if known > 0.0:
                hits += borrowed * within / known
                total += borrowed
        return hits / total


UNTRIED = AnswerTimes()
"""Nothing is known: answers are taken to come in time."""
