"""The choices that `coverage` compares."""

from __future__ import annotations

from collections.abc import Iterator

from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer


def mixes_of(scorer: Scorer) -> Mixes | None:
    """What robots may send, each on its own; None where they may not differ."""
    if not scorer.objective.rarer_hz or not scorer.knowledge.mixable or scorer.hopes:
        return None
    return Mixes(scorer)


def all_options(scorer: Scorer, mixes: Mixes | None = None) -> Iterator[Score]:
    """The ego alone, and all sets on the way of the greedy orders, at each pace that may be worth
    its slowness; and of `mixes` what its orders find."""
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
    if mixes is not None:
        yield from (mixes.grow(by_byte=by_byte) for by_byte in (True, False))
