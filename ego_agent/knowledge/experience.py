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
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from statistics import median

import numpy as np

from ego_agent.knowledge.answers import (
    ANOTHER_LINK,
    AnswerTimes,
    Pool,
    Weighted,
    little,
    on_another_link,
)
from swarm.messages import Algorithm

MEMORY_FRAMES = 20.0
"""Frames of one robot and algorithm that are remembered: two seconds at 10 Hz, so that a decision
whose answers stay away loses its credit within two or three cycles."""
LEAST_REMEMBERED = 5
"""Answers that are remembered at least. At lower rates one counts for up to a fifth of the memory,
so that two to five seconds are remembered whatever the rate."""
HALF_LIFE_S = 30.0
"""What is not seen again is half forgotten after this."""
POOL_EACH = 4.0
"""Frames that one robot counts for at most in what is told of all."""
CENSORED_S = 4.0
"""What an answer that never came counts for where times are compared."""
LEAST_ANSWERS = 3
"""Fewer answers do not tell how slow a robot is."""
SLOWEST = 16.0
"""A robot is taken to be this many times slower than the others at most, and 1/8 at least."""
FASTEST = 1.0 / 8.0
TOLD_S = 1.0
"""A controller tells once a second what its links are."""
DRAIN_S = 1.0
"""What was on its way over the wider link has left the queues by then."""
MAX_SERIES = 4096
"""Robots and algorithms that are remembered; the longest unheard is dropped."""


@dataclass(frozen=True, slots=True)
class Told:
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
        self._series: OrderedDict[tuple[str, Algorithm], deque[Told]] = OrderedDict()
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
            series = self._series.setdefault(key, deque(maxlen=round(MEMORY_FRAMES)))
            series.append(told)
            self._series.move_to_end(key)
            if len(self._series) > MAX_SERIES:
                self._series.popitem(last=False)

    def last(self, robot: str, algorithm: Algorithm) -> Told | None:
        """How the newest request for this ended."""
        with self._lock:
            series = self._series.get((robot, algorithm))
            return series[-1] if series else None

    def learnt(self, capacity_bps: float | None = None, *, configured: bool = True) -> Learnt:
        """All that is known by now, on a link of that C(t); `configured`: that is known, as a
        controller told it, not guessed."""
        now_s = self._clock()
        with self._lock:
            series = {key: tuple(told) for key, told in self._series.items() if told}
        return Learnt(series, now_s, capacity_bps, configured)

    def look(self, capacity_bps: float | None) -> None:
        """Takes C(t) of a control cycle, None where no controller told it, and forgets what a link
        explains that has become much narrower since the cycle before."""
        with self._lock:
            before, self._capacity_bps = self._capacity_bps, capacity_bps
            looked_s, self._looked_s = self._looked_s, self._clock()
            if before is None or capacity_bps is None or capacity_bps * ANOTHER_LINK >= before:
                return
            self._narrowed_s = looked_s - TOLD_S, self._looked_s + DRAIN_S
            for series in self._series.values():
                kept = [told for told in series if not self._is_explained(told)]
                series.clear()
                series.extend(kept)

    def _is_explained(self, told: Told) -> bool:
        """Whether it is late because the link had become narrower, and that was not known yet, or
        the queues were still full."""
        begin_s, end_s = self._narrowed_s
        return told.late and begin_s <= told.asked_s <= end_s


class Learnt:
    """What is known at one moment."""

    def __init__(
        self,
        series: Mapping[tuple[str, Algorithm], tuple[Told, ...]],
        now_s: float,
        capacity_bps: float | None,
        configured: bool = True,
    ) -> None:
        self._own = {
            key: tuple(_weighted(told, now_s, capacity_bps, configured))
            for key, told in series.items()
        }
        self._frames = {key: sum(map(_counts, own)) for key, own in self._own.items()}
        self._encode_s = {key: _median(t.encode_s for t in told) for key, told in series.items()}
        self._work_s = {key: _little(t.work_s for t in told) for key, told in series.items()}
        self._answer_s = {
            key: _median(t.answer_s for t in told if t.answer_s < math.inf and not t.at_least)
            for key, told in series.items()
        }
        self._slowness = _slowness(series)
        self._pools = self._pooled()

    def of(self, robot: str, algorithms: Iterable[Algorithm]) -> dict[Algorithm, AnswerTimes]:
        """What is known of a robot's answers; without algorithms of which nothing is known."""
        known = {}
        for algorithm in algorithms:
            key = (robot, algorithm)
            own, pool = self._own.get(key, ()), self._pools.get(algorithm)
            if own or pool is not None:
                known[algorithm] = AnswerTimes(
                    own,
                    pool,
                    self._slowness.get(robot, 1.0),
                    self._encode_s.get(key),
                    self._work_s.get(key),
                    self._answer_s.get(key),
                    self._frames.get(key, 0.0),
                )
        return known

    def _pooled(self) -> dict[Algorithm, Pool]:
        parts: dict[Algorithm, list[tuple[float, float, float]]] = {}
        for (robot, algorithm), own in self._own.items():
            slowness = self._slowness.get(robot, 1.0)
            share = min(1.0, POOL_EACH / max(1e-9, self._frames[robot, algorithm]))
            parts.setdefault(algorithm, []).extend(
                (
                    one.answer_s / slowness,
                    0.0 if one.at_least else one.timely * share,
                    one.late * share,
                )
                for one in own
            )
        pools = {}
        for algorithm, weighted in parts.items():
            table = np.array(sorted(weighted))
            pools[algorithm] = Pool(table[:, 0], *np.cumsum(table[:, 1:], axis=0).T)
        return pools


def _weighted(
    told: tuple[Told, ...], now_s: float, capacity_bps: float | None, configured: bool
) -> Iterable[Weighted]:
    """The newest answers up to MEMORY_FRAMES, each with the frames that it counts for by now."""
    left = MEMORY_FRAMES
    over, timely, late = capacity_bps, 1.0, 1.0
    for one in reversed(told):
        frames = min(one.frames, left)
        left -= frames
        frames *= math.exp2(-max(0.0, now_s - one.at_s) / HALF_LIFE_S)
        if capacity_bps is not None and one.capacity_bps != over:
            over = one.capacity_bps
            timely, late = on_another_link(capacity_bps / over, configured=configured)
        yield Weighted(one.answer_s, frames * timely, frames * late, one.at_least)
        if left <= 0.0:
            return


def _counts(one: Weighted) -> float:
    """Frames that an answer counts for at most, whatever the deadline."""
    never_in_time = one.at_least or one.answer_s == math.inf
    return one.late if never_in_time else max(one.timely, one.late)


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known else None


def _little(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return little(known) if known else None


def _slowness(series: Mapping[tuple[str, Algorithm], tuple[Told, ...]]) -> dict[str, float]:
    """How many times longer than usual each robot's answers take: the geometric mean, over its
    algorithms, of its median by the median of all robots' medians."""
    medians: dict[Algorithm, dict[str, float]] = {}
    for (robot, algorithm), told in series.items():
        if len(told) >= LEAST_ANSWERS:
            typical = median(min(t.answer_s, CENSORED_S) for t in told)
            medians.setdefault(algorithm, {})[robot] = max(1e-3, typical)
    ratios: dict[str, list[float]] = {}
    for by_robot in medians.values():
        usual = median(by_robot.values())
        for robot, typical in by_robot.items():
            ratios.setdefault(robot, []).append(math.log(typical / usual))
    return {
        robot: min(SLOWEST, max(FASTEST, math.exp(sum(logs) / len(logs))))
        for robot, logs in ratios.items()
    }
