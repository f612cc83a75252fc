"""The choices that `coverage` compares."""

from __future__ import annotations

from collections.abc import Iterator

from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.scoring import Score, Scorer


def all_options(scorer: Scorer) -> Iterator[Score]:
    """The ego alone, and all sets on the way of the greedy orders, at each pace that may be worth
    its slowness."""
    knowledge = scorer.knowledge
    alone = scorer.score((), knowledge.best_algorithm())
    yield alone
    best = alone.value
    for algorithm in knowledge.algorithms:
        for pace in scorer.paces:
            at = scorer.at(pace)
            if pace is not scorer.paces[0] and at.most(algorithm) <= best:
                continue
            for by_byte in (True, False):
                for score in grow(at, scorer.scene.candidates, algorithm, by_byte=by_byte):
                    best = max(best, score.value)
                    yield score
            if at.slower_is_worse(algorithm):
                break
