"""The deterministic policy of the product, and the fallback of every other one.

Robots join greedily, best marginal coverage first, while the link can carry them. Every set on the
way is an option, for each algorithm; the best option wins, unless the decision in force is as good.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ego_agent.greedy import grow
from ego_agent.knowledge import Knowledge
from ego_agent.model import Proposal, UnifiedScene
from ego_agent.scoring import Score, Scorer
from swarm.messages import Decision


@dataclass(frozen=True)
class Coverage:
    """Maximises Q - lambda C within Q_min and the link; slow to change its mind."""

    name: str = "coverage"

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """The best option that was found, or the decision in force if that is as good."""
        best, reason = self.choose(Scorer(scene, knowledge), previous)
        return Proposal(
            participants=(scene.ego.robot, *best.participants),
            algorithm=best.algorithm,
            reason=reason,
            source="policy",
        )

    def choose(self, scorer: Scorer, previous: Decision | None) -> tuple[Score, str]:
        """The same as a score, and its reason."""
        options = list(_options(scorer))
        best = _best(scorer, options)
        held = _still_possible(scorer, previous)
        if held is not None:
            best = _settle(scorer, options, best, held)
        return best, _reason(scorer, best, kept=best is held)


def _options(scorer: Scorer) -> Iterator[Score]:
    """The ego alone, and all sets on the way of the greedy orders."""
    knowledge = scorer.knowledge
    yield scorer.score((), knowledge.best_algorithm())
    for algorithm in knowledge.algorithms:
        for by_byte in (True, False):
            yield from grow(scorer, scorer.scene.candidates, algorithm, by_byte=by_byte)


def _best(scorer: Scorer, options: list[Score]) -> Score:
    """The best value among the options that reach Q_min; the best quality where none does."""
    good = [option for option in options if scorer.good_enough(option)]
    if good:
        return min(good, key=lambda o: (-o.value, o.cost_bytes, o.participants))
    return min(options, key=lambda o: (-o.quality, o.cost_bytes, o.participants))


def _still_possible(scorer: Scorer, previous: Decision | None) -> Score | None:
    """The decision in force, scored in the new scene; None where it cannot be carried on."""
    if previous is None or previous.algorithm not in scorer.knowledge.algorithms:
        return None
    others = [robot for robot in previous.participants if robot != scorer.scene.ego.robot]
    if not all(scorer.can(robot, previous.algorithm) for robot in others):
        return None
    score = scorer.score(others, previous.algorithm)
    return score if scorer.fits(score) else None


def _settle(scorer: Scorer, options: list[Score], best: Score, held: Score) -> Score:
    """Keeps the decision in force unless a change pays, so that decisions do not flap.

    A change must gain `switch_gain`; one that costs more must also leave `upgrade_reserve` of the
    budget free, so that a small drop of C(t) does not undo it at once. Reaching Q_min goes before
    both.
    """
    objective = scorer.objective
    if scorer.good_enough(best) and not scorer.good_enough(held):
        return best
    roomy = scorer.budget_bytes * (1.0 - objective.upgrade_reserve)
    best = _best(scorer, [o for o in options if o.cost_bytes <= max(held.cost_bytes, roomy)])
    if not scorer.good_enough(held):
        gain = best.quality - held.quality
    elif scorer.good_enough(best):
        gain = best.value - held.value
    else:
        return held
    return best if gain > objective.switch_gain else held


def _reason(scorer: Scorer, score: Score, *, kept: bool) -> str:
    """One sentence for people."""
    share = score.quality / scorer.knowledge.factors[score.algorithm]
    text = (
        f"The ego and {len(score.participants)} of {len(scorer.scene.candidates)} robots in range "
        f"see {100 * share:.0f} % of what all see; {score.algorithm} fusion costs "
        f"{score.cost_bytes / 1e3:.1f} of {scorer.budget_bytes / 1e3:.1f} kB a frame"
    )
    if not scorer.good_enough(score):
        text += f"; {score.quality:.2f} is the best quality, below {scorer.objective.q_min:.2f}"
    return text + ("; kept, no change pays." if kept else ".")


POLICIES = (Coverage,)
