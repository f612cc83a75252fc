"""The best of several options, unless the decision in force is as good."""

from __future__ import annotations

from collections.abc import Sequence

from ego_agent.scoring import Score, Scorer
from swarm.messages import Decision


def best_option(scorer: Scorer, options: Sequence[Score]) -> Score:
    """The best value among the options that reach Q_min; the best quality where none does."""
    good = [option for option in options if scorer.good_enough(option)]
    if good:
        return min(good, key=lambda o: (-o.value, o.cost_bytes, o.participants))
    return min(options, key=lambda o: (-o.quality, o.cost_bytes, o.participants))


def still_possible(scorer: Scorer, previous: Decision | None) -> Score | None:
    """The decision in force, scored in the new scene; None where it cannot be carried on."""
    if previous is None or previous.algorithm not in scorer.knowledge.algorithms:
        return None
    others = [robot for robot in previous.participants if robot != scorer.scene.ego.robot]
    if not all(scorer.can(robot, previous.algorithm) for robot in others):
        return None
    score = scorer.score(others, previous.algorithm)
    return score if scorer.fits(score) else None


def settle(scorer: Scorer, options: Sequence[Score], best: Score, held: Score) -> Score:
    """Keeps the decision in force unless a change pays, so that decisions do not flap.

    A change must gain `switch_gain`; one that costs more must also leave `upgrade_reserve` of the
    budget free, so that a small drop of C(t) does not undo it at once. Reaching Q_min goes before
    both.
    """
    objective = scorer.objective
    if scorer.good_enough(best) and not scorer.good_enough(held):
        return best
    roomy = scorer.budget_bytes * (1.0 - objective.upgrade_reserve)
    best = best_option(scorer, [o for o in options if o.cost_bytes <= max(held.cost_bytes, roomy)])
    if not scorer.good_enough(held):
        gain = best.quality - held.quality
    elif scorer.good_enough(best):
        gain = best.value - held.value
    else:
        return held
    return best if gain > objective.switch_gain else held
