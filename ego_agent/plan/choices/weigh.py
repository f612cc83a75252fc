"""What a decision was weighed against, for the journal: each robot, and the best other choice."""

from __future__ import annotations

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.weighed import MAX_WEIGHED, Other, Verdict, Weighed, Weighing
from ego_agent.plan.choices.hysteresis import best_option
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.options import all_options, mixes_of
from ego_agent.plan.choices.scoring import Score, Scorer
from swarm.messages import Decision

DIGITS = 4


def weigh(scene: UnifiedScene, knowledge: Knowledge, decision: Decision) -> Weighed:
    """How the decision stands in the scene that it was made in; quality to four digits."""
    fastest = Scorer(scene, knowledge)
    scorer = fastest.at_rate(decision.rate_hz)
    chosen = score_of(scorer, decision)
    if decision.assignments:
        robots = assigned_weighings(scorer, decision)
    else:
        robots = {
            candidate.robot: weighing(scorer, candidate.robot, decision, chosen)
            for candidate in scene.candidates
        }
    order = sorted(
        robots, key=lambda r: (r not in decision.participants, -(robots[r].adds or 0.0), r)
    )
    objective = knowledge.objective
    return Weighed(
        value=round(chosen.value, DIGITS),
        budget_bytes=scorer.budget_bytes,
        q_min=objective.q_min,
        switch_gain=objective.switch_gain,
        dwell_s=objective.dwell_s,
        upgrade_reserve=objective.upgrade_reserve,
        robots={robot: robots[robot] for robot in order[:MAX_WEIGHED]},
        left_out=max(0, len(order) - MAX_WEIGHED),
        other=_other(fastest, decision),
    )


def score_of(scorer: Scorer, decision: Decision) -> Score:
    """The decision's own score, by a scorer at its pace."""
    if decision.assignments:
        mixes = Mixes(scorer)
        score = mixes.score([one for one in decision.assignments if mixes.can(one)])
        if score is not None:
            return score
    able = [r for r in decision.participants if scorer.known(r, decision.algorithm)]
    return scorer.score(able, decision.algorithm)


def assigned_weighings(scorer: Scorer, decision: Decision) -> dict[str, Weighing]:
    """Every candidate, where robots differ in what they send and how often."""
    brought = Mixes(scorer).brought(decision.assignments)
    found = {}
    for candidate in scorer.scene.candidates:
        one = brought.get(candidate.robot)
        if one is None:
            found[candidate.robot] = Weighing(adds=None, costs=None, why="link")
            continue
        why: Verdict = "pays" if one.adds >= one.costs else "kept"
        if candidate.robot not in decision.participants:
            why = "fit" if not one.fits else "kept" if one.adds > one.costs else "costs"
        adds, costs = round(one.adds, DIGITS), round(one.costs, DIGITS)
        found[candidate.robot] = Weighing(adds=adds, costs=costs, why=why)
    return found


def weighing(scorer: Scorer, robot: str, decision: Decision, chosen: Score) -> Weighing:
    """One candidate, by a scorer at the decision's pace; `chosen` is the decision's own score."""
    algorithm = decision.algorithm
    if not scorer.known(robot, algorithm):
        return Weighing(adds=None, costs=None, why="size")
    if not scorer.can(robot, algorithm):
        return Weighing(adds=None, costs=None, why="link")
    taken = robot in decision.participants
    others = [r for r in chosen.participants if r != robot]
    without = scorer.score(others, algorithm) if taken else chosen
    with_it = chosen if taken else scorer.score([*others, robot], algorithm)
    adds, costs = with_it.quality - without.quality, with_it.cost - without.cost
    why: Verdict = "pays" if adds >= costs else "kept"
    if taken and adds < costs:
        if scorer.good_enough(with_it) and not scorer.good_enough(without):
            why = "q_min"
    elif not taken and not scorer.fits(with_it):
        why = "fit"
    elif not taken:
        why = "kept" if adds > costs else "costs"
    return Weighing(adds=round(adds, DIGITS), costs=round(costs, DIGITS), why=why)


def _other(scorer: Scorer, decision: Decision) -> Other | None:
    """The best of what `coverage` compares that has other participants or another algorithm."""
    same = (frozenset(decision.participants[1:]), decision.algorithm)
    options = [
        option
        for option in all_options(scorer, mixes_of(scorer))
        if (frozenset(option.participants), option.algorithm) != same
        and (option.participants or same[0])
    ]
    if not options:
        return None
    best = best_option(scorer, options)
    return Other(
        participants=(scorer.scene.ego.robot, *best.participants),
        algorithm=best.algorithm,
        rate_hz=best.pace.rate_hz,
        quality=round(best.quality, DIGITS),
        cost_bytes=best.cost_bytes,
        budget_bytes=scorer.at(best.pace).budget_bytes,
        value=round(best.value, DIGITS),
    )
