"""What all answers tell at one moment: of each robot and algorithm, and of all robots together.

Tables have a row a series (one robot and algorithm) and a column an answer, the newest first.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.answers import LITTLE, NOTHING, AnswerTimes, Pool
from ego_agent.knowledge.series import COLUMN, MEMORY_FRAMES, MOST_ANSWERS
from swarm.messages import Algorithm

Table = NDArray[np.float64]

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
ANOTHER_LINK = 2.0
"""A link that is more than this many times wider or narrower is another one."""
NO_ANSWERS = np.zeros((0, MOST_ANSWERS, len(COLUMN)))


class Learnt:
    """What is known at one moment."""

    def __init__(
        self,
        keys: Sequence[tuple[str, Algorithm]],
        answers: Table,
        used: NDArray[np.intp],
        now_s: float,
        capacity_bps: float | None,
        configured: bool = True,
    ) -> None:
        """`answers`: (S, MOST_ANSWERS, COLUMN), a `Series.table` of each key, of which the first
        `used` (S,) hold something; `capacity_bps`, `configured`: see `Experience.learnt`."""
        there = np.arange(answers.shape[1]) < used[:, None]

        def column(name: str, missing: float = np.nan) -> Table:
            return np.where(there, answers[:, :, COLUMN[name]], missing)

        answer_s, at_least = column("answer_s", np.inf), column("at_least", 0.0) > 0.0
        timely, late = _counts(
            column("frames", 0.0),
            now_s - column("at_s", now_s),
            column("capacity_bps", 1.0),
            capacity_bps,
            configured=configured,
        )
        came = np.isfinite(answer_s) & ~at_least
        # Whatever the deadline, one that never came, or took longer than told, cannot be in time.
        most = np.where(came, np.maximum(timely, late), late)
        timely = np.where(at_least, 0.0, timely)
        frames = most.sum(axis=1)
        self._place = {key: place for place, key in enumerate(keys)}
        self._slowness = _slowness(keys, np.where(there, answer_s, np.nan), used)
        self._own = _ranked(answer_s, timely, late)
        self._pools = self._pooled(keys, there, answer_s, timely, late, frames)
        self._frames: list[float] = frames.tolist()
        self._encode_s = _middle(column("encode_s"))
        self._work_s = _little(column("work_s"))
        self._answer_s = _middle(np.where(came, answer_s, np.nan))

    def of(self, robot: str, algorithms: Iterable[Algorithm]) -> dict[Algorithm, AnswerTimes]:
        """What is known of a robot's answers; without algorithms of which nothing is known."""
        known = {}
        slowness = self._slowness.get(robot, 1.0)
        for algorithm in algorithms:
            pool, place = self._pools.get(algorithm), self._place.get((robot, algorithm))
            if place is not None:
                known[algorithm] = AnswerTimes(
                    self._own[place],
                    pool,
                    slowness,
                    self._encode_s[place],
                    self._work_s[place],
                    self._answer_s[place],
                    self._frames[place],
                )
            elif pool is not None:
                known[algorithm] = AnswerTimes(NOTHING, pool, slowness)
        return known

    def _pooled(
        self,
        keys: Sequence[tuple[str, Algorithm]],
        there: NDArray[np.bool_],
        answer_s: Table,
        timely: Table,
        late: Table,
        frames: Table,
    ) -> dict[Algorithm, Pool]:
        """All robots' answers by algorithm, as of a robot of usual speed."""
        slowness = np.array([self._slowness.get(robot, 1.0) for robot, _ in keys])
        share = np.minimum(1.0, POOL_EACH / np.maximum(1e-9, frames))
        rows: dict[Algorithm, list[int]] = {}
        for place, (_, algorithm) in enumerate(keys):
            rows.setdefault(algorithm, []).append(place)
        pools = {}
        for algorithm, some in rows.items():
            held = there[some]
            usual_s = (answer_s[some] / slowness[some, None])[held]
            shares = share[some, None]
            own = (usual_s, (timely[some] * shares)[held], (late[some] * shares)[held])
            (pools[algorithm],) = _ranked(*(one[None, :] for one in own))
        return pools


def _counts(
    frames: Table,
    ago_s: Table,
    told_bps: Table,
    capacity_bps: float | None,
    *,
    configured: bool,
) -> tuple[Table, Table]:
    """What answers count for where they are in time, and late: the newest up to MEMORY_FRAMES,
    faded, on a link of that C(t) where they were told on one of `told_bps`."""
    before = np.cumsum(frames, axis=1) - frames
    counted = np.clip(MEMORY_FRAMES - before, 0.0, frames)
    counted *= np.exp2(-np.maximum(0.0, ago_s) / HALF_LIFE_S)
    if capacity_bps is None:
        return counted, counted
    timely, late = _on_another_link(capacity_bps / told_bps, configured=configured)
    return counted * timely, counted * late


def _on_another_link(wider: Table, *, configured: bool) -> tuple[Table, Table]:
    """What answers count for, in time and late, on a link that is so many times wider than theirs;
    `configured`: that is known, not guessed.

    What came in time comes in time over a wider link, too, and what was late is late over a
    narrower one; the reverse is less and less likely, the more the link has changed. A link that is
    known to be several times wider says nothing of what was late.
    """
    timely = np.minimum(1.0, ANOTHER_LINK * wider)
    if configured:
        return timely, np.clip(2.0 - wider / ANOTHER_LINK, 0.0, 1.0)
    return timely, np.minimum(1.0, ANOTHER_LINK / wider)


def _ranked(answer_s: Table, timely: Table, late: Table) -> list[Pool]:
    """The answers of each row by the time that they took."""
    order = np.argsort(answer_s, axis=1, kind="stable")
    columns = (
        np.take_along_axis(answer_s, order, axis=1).tolist(),
        np.cumsum(np.take_along_axis(timely, order, axis=1), axis=1).tolist(),
        np.cumsum(np.take_along_axis(late, order, axis=1), axis=1).tolist(),
    )
    return [Pool(*row) for row in zip(*columns, strict=True)]


def _middle(values: Table) -> list[float | None]:
    """The median of each row (S, N) without NaN; None where there is none."""
    ranked, known = np.sort(values, axis=1), np.isfinite(values).sum(axis=1)
    rows = np.arange(len(values))
    low, high = np.maximum(known - 1, 0) // 2, known // 2
    middle = 0.5 * (ranked[rows, low] + ranked[rows, np.minimum(high, values.shape[1] - 1)])
    return [one if some else None for one, some in zip(middle.tolist(), known, strict=True)]


def _little(values: Table) -> list[float | None]:
    """See `answers.little`, of each row (S, N) without NaN; None where there is none."""
    ranked, known = np.sort(values, axis=1), np.isfinite(values).sum(axis=1)
    low = ranked[np.arange(len(values)), (LITTLE * known).astype(np.intp)]
    return [one if some else None for one, some in zip(low.tolist(), known, strict=True)]


def _slowness(
    keys: Sequence[tuple[str, Algorithm]], answer_s: Table, used: NDArray[np.intp]
) -> dict[str, float]:
    """How many times longer than usual each robot's answers take: the geometric mean, over its
    algorithms, of its median by the median of all robots' medians. `answer_s`: NaN for none."""
    typical = _middle(np.minimum(answer_s, CENSORED_S))
    medians: dict[Algorithm, dict[str, float]] = {}
    for (robot, algorithm), middle, count in zip(keys, typical, used, strict=True):
        if count >= LEAST_ANSWERS and middle is not None:
            medians.setdefault(algorithm, {})[robot] = max(1e-3, middle)
    ratios: dict[str, list[float]] = {}
    for by_robot in medians.values():
        usual = median(by_robot.values())
        for robot, middle in by_robot.items():
            ratios.setdefault(robot, []).append(math.log(middle / usual))
    return {
        robot: min(SLOWEST, max(FASTEST, math.exp(sum(logs) / len(logs))))
        for robot, logs in ratios.items()
    }
