"""Greedy growth of a set of participants under the link's budget.

Coverage is monotone and submodular (areas: union; objects: maximum), and so is its expectation over
independent arrivals (union.py); so the better of the order by
gain a byte and the order by gain reaches at least (1 - 1/e)/2 of the best gain under a budget
(Leskovec et al., "Cost-effective Outbreak Detection in Networks", KDD 2007).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ego_agent.knowledge.model import Candidate
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.union import Union
from swarm.messages import Algorithm

SMALLEST_GAIN = 1e-9
"""Less is a rounding error, not coverage."""


def grow(
    scorer: Scorer, candidates: tuple[Candidate, ...], algorithm: Algorithm, *, by_byte: bool
) -> Iterator[Score]:
    """Scores of growing sets: the ego and first one, then two ... of the candidates.

    The next one is always that with the largest gain, or gain a byte, that the budget still
    carries; equal gains go to the smaller id. It ends when nobody fits or nobody adds anything.
    """
    able = sorted((c for c in candidates if scorer.can(c.robot, algorithm)), key=lambda c: c.robot)
    rows = np.array([scorer.row_of[c.robot] for c in able], dtype=np.intp)
    sizes = np.array([c.sizes[algorithm] for c in able], dtype=np.int64)
    arrival, union = scorer.counting(algorithm), Union(scorer.views)
    share, spent = scorer.share([0]), 0
    chosen: list[int] = []
    while rows.size:
        gains = union.gains(rows, arrival[rows])
        useful = (gains > SMALLEST_GAIN) & (spent + sizes <= scorer.budget_bytes)
        rows, sizes, gains = rows[useful], sizes[useful], gains[useful]
        if not rows.size:
            return
        order = gains / sizes if by_byte else gains
        if scorer.scene.preferred:
            order = order * scorer.liking(rows)
        at = int(np.argmax(order))
        row = int(rows[at])
        chosen.append(row)
        share, spent = share + float(gains[at]), spent + int(sizes[at])
        union.add(row, float(arrival[row]))
        rows, sizes = np.delete(rows, at), np.delete(sizes, at)
        robots = tuple(scorer.scene.candidates[r - 1].robot for r in sorted(chosen))
        yield scorer.score_of(robots, algorithm, share, spent)
