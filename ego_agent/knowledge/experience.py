"""What answers have taught: how long each robot takes, algorithm by algorithm, with forgetting.

The latest answers count, by the number of frames that waited for each; what is older loses half of
its weight in HALF_LIFE_S. Where a robot has shown little of an algorithm it borrows: from all
robots' answers with that algorithm, made longer or shorter by how slow the robot is elsewhere; and
before anybody has shown anything, answers are taken to come in time, so that they are tried.

When a controller has made the link much narrower, the answers that were late meanwhile were too
many for it. That says nothing of the robot or the algorithm, and choices are held against the link
anyway: such answers are forgotten. A link that was found narrower by what it carries is another
matter: the ego had tried too much.

All times are `time.monotonic()` seconds of the ego, or differences that a robot measured on its own
steady clock: a wall clock that jumps changes nothing here.
"""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable

import numpy as np

from ego_agent.knowledge.learnt import ANOTHER_LINK, NO_ANSWERS, Learnt
from ego_agent.knowledge.series import MEMORY_FRAMES, Series, Told
from swarm.messages import Algorithm

LEAST_REMEMBERED = 5
"""Answers that are remembered at least. At lower rates one counts for up to a fifth of the memory,
so that two to five seconds are remembered whatever the rate."""
TOLD_S = 1.0
"""A controller tells once a second what its links are."""
DRAIN_S = 1.0
"""What was on its way over the wider link has left the queues by then, or beacons still stand in
them."""
DRAIN_MOST_S = 10.0
"""Queues that stand for longer are filled by what is asked now."""
MAX_SERIES = 4096
"""Robots and algorithms that are remembered; the longest unheard is dropped."""


def frames_of(waited_s: float, rate_hz: float, usual_hz: float) -> float:
    """Frames that an answer counts for which kept a robot waiting so long at a rate, where
    `usual_hz` is the usual one: at a lower rate each counts for more."""
    most = MEMORY_FRAMES / LEAST_REMEMBERED
    return max(1.0, waited_s * rate_hz) * min(most, max(1.0, usual_hz / rate_hz))


class Experience:
    """How requests ended. The fusion thread records, the control cycle reads."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._series: OrderedDict[tuple[str, Algorithm], Series] = OrderedDict()
        self._capacity_bps: float | None = None
        """C(t) of the last cycle, where a controller told it."""
        self._looked_s = -math.inf
        """When that was."""
        self._narrowed_s = -math.inf, -math.inf
        """Between which times C(t) last became much narrower."""

    def record(
        self,
        robot: str,
        algorithm: Algorithm,
        answer_s: float,
        *,
        frames: float = 1.0,
        encode_s: float | None = None,
        work_s: float | None = None,
        capacity_bps: float = 1.0,
        at_least: bool = False,
        asked_s: float | None = None,
        deadline_s: float = math.inf,
    ) -> None:
        """Notes that a request has ended now: `answer_s` after it was sent, infinite where no
        usable answer came; `at_least`: that it takes longer than that. `frames` is how many frames
        it kept waiting, `capacity_bps` C(t) when it was sent, at `asked_s` (where None, `answer_s`
        ago); what comes after `deadline_s` is late."""
        now_s = self._clock()
        if asked_s is None:
            asked_s = now_s - answer_s if answer_s < math.inf else now_s
        told = Told(
            at_s=now_s,
            asked_s=asked_s,
            answer_s=max(0.0, answer_s),
            frames=max(1.0, frames),
            encode_s=encode_s,
            work_s=work_s,
            capacity_bps=max(1.0, capacity_bps),
            at_least=at_least,
            late=answer_s > deadline_s,
        )
        key = (robot, algorithm)
        with self._lock:
            if self._is_explained(told):
                return
            series = self._series.get(key)
            if series is None:
                series = self._series[key] = Series()
            series.take(told)
            self._series.move_to_end(key)
            if len(self._series) > MAX_SERIES:
                self._series.popitem(last=False)

    def last(self, robot: str, algorithm: Algorithm) -> Told | None:
        """How the newest request for this ended."""
        with self._lock:
            series = self._series.get((robot, algorithm))
            return None if series is None else series.newest()

    def learnt(self, capacity_bps: float | None = None, *, configured: bool = True) -> Learnt:
        """All that is known by now, on a link of that C(t); `configured`: that is known, as a
        controller told it, not guessed."""
        now_s = self._clock()
        with self._lock:
            keys = [key for key, series in self._series.items() if len(series)]
            used = np.array([len(self._series[key]) for key in keys], dtype=np.intp)
            tables = [self._series[key].table for key in keys]
            answers = np.stack(tables) if tables else NO_ANSWERS
        return Learnt(keys, answers, used, now_s, capacity_bps, configured)

    def look(self, capacity_bps: float | None, *, standing: bool = False) -> None:
        """Takes C(t) of a control cycle, None where no controller told it, and forgets what a link
        explains that has become much narrower since the cycle before. `standing`: that beacons
        still stand in the queues before it."""
        with self._lock:
            before, self._capacity_bps = self._capacity_bps, capacity_bps
            looked_s, self._looked_s = self._looked_s, self._clock()
            if before is None or capacity_bps is None:
                return
            begin_s, end_s = self._narrowed_s
            if capacity_bps * ANOTHER_LINK < before:
                begin_s = looked_s - TOLD_S
            # Cycles are a second apart or a little more: the last window may be just over.
            elif not standing or self._looked_s > min(end_s + TOLD_S, begin_s + DRAIN_MOST_S):
                return
            self._narrowed_s = begin_s, self._looked_s + DRAIN_S
            for series in self._series.values():
                series.forget(*self._narrowed_s)

    def _is_explained(self, told: Told) -> bool:
        """Whether it is late because the link had become narrower, and that was not known yet, or
        the queues were still full."""
        begin_s, end_s = self._narrowed_s
        return told.late and begin_s <= told.asked_s <= end_s
