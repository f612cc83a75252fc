"""How long one robot's answers with one algorithm take, and how likely they are in time."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

POOL_WEIGHT = 2.0
"""Frames that the other robots' answers count for beside a robot's own."""
PRIOR_WEIGHT = 0.5
"""Frames that the belief counts for that answers come in time."""
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
    """Where it was in time; 0 where it took longer than told."""
    late: float
    """Where it was late."""


@dataclass(frozen=True, slots=True)
class Pool:
    """Answers by the time that they took."""

    times_s: Sequence[float]
    """Rising; infinite for those that never came."""
    timely: Sequence[float]
    """Frames of each time and all before it that count where that is in time: answers whose time
    is known."""
    late: Sequence[float]
    """The same that count where that is late, of all answers."""

    @classmethod
    def of(cls, answers: Iterable[Weighted]) -> Pool:
        """These together."""
        ranked = sorted(answers)
        return cls(
            [one.answer_s for one in ranked],
            list(accumulate(one.timely for one in ranked)),
            list(accumulate(one.late for one in ranked)),
        )

    def within(self, limit_s: float) -> tuple[float, float]:
        """Frames whose answer took no longer, and all of which that is known. Of one that took
        longer than told it is not known where that is less than the limit."""
        if not self.times_s:
            return 0.0, 0.0
        at = bisect_right(self.times_s, limit_s)
        hits, in_time = (self.timely[at - 1], self.late[at - 1]) if at else (0.0, 0.0)
        return hits, hits + self.late[-1] - in_time

    @property
    def never(self) -> float:
        """Frames whose answer never came."""
        at = bisect_left(self.times_s, math.inf)
        if at == len(self.times_s):
            return 0.0
        return self.late[-1] - (self.late[at - 1] if at else 0.0)


NOTHING = Pool((), (), ())


@dataclass(frozen=True, slots=True)
class AnswerTimes:
    """What is known of one robot's answers with one algorithm."""

    own: Pool = NOTHING
    """Its own answers."""
    pool: Pool | None = None
    """All robots' answers with the algorithm, as of a robot of usual speed."""
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
        return self.own.never / self.frames if self.frames > 0.0 else 0.0

    @property
    def transfer_s(self) -> float | None:
        """What its answers take beside encoding: the way, and waiting for processors."""
        if self.answer_s is None or self.encode_s is None:
            return None
        return max(0.0, self.answer_s - self.encode_s)

    def in_time(self, deadline_s: float) -> float:
        """Probability that an answer comes within the deadline."""
        hits, total = self.own.within(deadline_s)
        hits, total = hits + PRIOR_WEIGHT, total + PRIOR_WEIGHT
        if self.pool is not None:
            within, known = self.pool.within(deadline_s / self.slowness)
            borrowed = min(POOL_WEIGHT, known)
            if known > 0.0:
                hits += borrowed * within / known
                total += borrowed
        return hits / total


UNTRIED = AnswerTimes()
"""Nothing is known: answers are taken to come in time."""
