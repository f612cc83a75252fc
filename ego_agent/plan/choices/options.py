"""The choices that `coverage` compares."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer


@dataclass(frozen=True, slots=True)
class Compared:
    """The choices in a scene, and what scored them."""

    scorer: Scorer
    options: tuple[Score, ...]
    mixes: Mixes | None
    """What robots may send each, at the scorer's pace; None where all send the same."""


def compare(scorer: Scorer) -> Compared:
    """All options, and where robots may differ in what they send, and how often, also the choices
    that the greedy orders find among such."""
    options, mixes = list(all_options(scorer)), None
    if scorer.objective.rarer_hz and scorer.knowledge.mixable:
        mixes = Mixes(scorer)
        options += [mixes.grow(by_byte=by_byte) for by_byte in (True, False)]
    return Compared(scorer, tuple(options), mixes)


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
