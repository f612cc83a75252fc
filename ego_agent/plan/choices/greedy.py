"""Greedy growth of a set of participants under the link's budget.

Coverage is monotone and submodular (areas: union; objects: maximum), and so is its expectation over
independent arrivals (union.py); so the better of the order by
gain a byte and the order by gain reaches at least (1 - 1/e)/2 of the best gain under a budget
(Leskovec et al., "Cost-effective Outbreak Detection in Networks", KDD 2007).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.model import Candidate
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.union import Union
from swarm.messages import Algorithm

Floats = NDArray[np.float64]

SMALLEST_GAIN = 1e-9
"""Less is a rounding error, not coverage."""
AT_A_TIME = 16
"""Rows whose gains are worked out together."""


def grow(
    scorer: Scorer, candidates: tuple[Candidate, ...], algorithm: Algorithm, *, by_byte: bool
) -> Iterator[Score]:
    """Scores of growing sets: the ego and first one, then two ... of the candidates.

    The next one is always that with the largest gain, or gain a byte, that the budget still
    carries; equal gains go to the smaller id. It ends when nobody fits or nobody adds anything.
    """
    rows = scorer.able(algorithm)
    if candidates is not scorer.scene.candidates:
        rows = rows[np.isin(rows, [scorer.row_of[c.robot] for c in candidates])]
    robots = scorer.scene.candidates
    sizes = np.array([robots[row - 1].sizes[algorithm] for row in rows], dtype=np.float64)
    likings = scorer.liking(rows) if scorer.scene.preferred else np.ones(len(rows))
    arrival, union = scorer.counting(algorithm), Union(scorer.views)
    # What each row gains at most: what it gained when that was last worked out.
    most = arrival[rows] * scorer.views.alone[rows]
    share, spent, cost = scorer.own_share, 0, 0.0
    chosen: list[int] = []
    while True:
        useful = (most > SMALLEST_GAIN) & (spent + sizes <= scorer.budget_bytes)
        rows = rows[useful]
        sizes, likings, most = sizes[useful], likings[useful], most[useful]
        if not rows.size:
            return
        worth = likings / sizes if by_byte else likings
        at = _largest(union, rows, arrival[rows], most, worth) if chosen else _first(most, worth)
        if most[at] <= SMALLEST_GAIN:
            continue
        row = int(rows[at])
        chosen.append(row)
        share, spent = share + float(most[at]), spent + int(sizes[at])
        union.add(row, float(arrival[row]))
        rows = np.delete(rows, at)
        sizes, likings, most = (np.delete(one, at) for one in (sizes, likings, most))
        cost += scorer.cost([robots[row - 1].robot], algorithm)
        joined = tuple(robots[row - 1].robot for row in sorted(chosen))
        yield scorer.score_of(joined, algorithm, share, spent, cost)


def _first(most: Floats, worth: Floats) -> int:
    """Where the largest product is."""
    return int(np.argmax(most * worth))


def _largest(
    union: Union, rows: NDArray[np.intp], arrival: Floats, most: Floats, worth: Floats
) -> int:
    """Where the row is that gains most, each gain times its worth; brings `most` up to date there.

    Gains only fall while a set grows, so only those are worked out that may be the largest by what
    they gained before (Minoux, "Accelerated greedy algorithms", 1978).
    """
    stale = np.ones(len(rows), dtype=np.bool_)
    while stale[at := _first(most, worth)]:
        left = np.flatnonzero(stale)
        if len(left) > AT_A_TIME:
            order = (most * worth)[left]
            left = left[np.argpartition(order, -AT_A_TIME)[-AT_A_TIME:]]
        most[left] = union.gains(rows[left], arrival[left])
        stale[left] = False
    return at
