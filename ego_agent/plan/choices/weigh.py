"""What a decision was weighed against, for the journal: each robot, and the best other choice."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ego_agent.knowledge.weighed import MAX_WEIGHED, Other, Verdict, Weighed, Weighing
from ego_agent.plan.choices.hysteresis import best_option
from ego_agent.plan.choices.mixes import Brought, Mixes
from ego_agent.plan.choices.options import Compared
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.union import Union
from swarm.messages import Decision

DIGITS = 4


def weigh(compared: Compared, decision: Decision) -> Weighed:
    """How the decision stands in the scene that it was made in, among the choices that were
    compared there; quality to four digits."""
    scorer = compared.scorer.at_rate(decision.rate_hz)
    if decision.assignments:
        mixes = compared.mixes
        if mixes is None or mixes.scorer is not scorer:
            mixes = Mixes(scorer)
        chosen = mixes.score_able(decision.assignments)
        brought = mixes.brought(decision.assignments)
        robots = {
            c.robot: _assigned(brought.get(c.robot), c.robot in decision.participants)
            for c in scorer.scene.candidates
        }
    else:
        chosen, robots = weighings(scorer, decision)
    order = sorted(
        robots, key=lambda r: (r not in decision.participants, -(robots[r].adds or 0.0), r)
    )
    objective = scorer.objective
    return Weighed(
        value=round(chosen.value, DIGITS),
        budget_bytes=scorer.budget_bytes,
        q_min=objective.q_min,
        switch_gain=objective.switch_gain,
        dwell_s=objective.dwell_s,
        upgrade_reserve=objective.upgrade_reserve,
        robots={robot: robots[robot] for robot in order[:MAX_WEIGHED]},
        left_out=max(0, len(order) - MAX_WEIGHED),
        other=_other(compared, decision),
    )


def weighings(scorer: Scorer, decision: Decision) -> tuple[Score, dict[str, Weighing]]:
    """The score of a decision in which all send the same, by a scorer at its pace, and what each
    candidate brings to it."""
    able = [r for r in decision.participants if scorer.known(r, decision.algorithm)]
    chosen = scorer.score(able, decision.algorithm)
    joined = _joined(scorer, chosen)
    robots = (candidate.robot for candidate in scorer.scene.candidates)
    return chosen, {robot: _weighing(scorer, robot, decision, chosen, joined) for robot in robots}


def _joined(scorer: Scorer, chosen: Score) -> dict[str, Score]:
    """The choice with one candidate more, by each that it lacks and that can send: what they add
    is counted together."""
    algorithm, members = chosen.algorithm, [scorer.row_of[r] for r in chosen.participants]
    robots = [c.robot for c in scorer.scene.candidates if scorer.can(c.robot, algorithm)]
    robots = [robot for robot in robots if robot not in chosen.participants]
    rows = np.array([scorer.row_of[robot] for robot in robots], dtype=np.intp)
    counts, union = scorer.counting(algorithm), Union(scorer.views)
    for row in members:
        union.add(row, float(counts[row]))
    share = scorer.share([0, *members], algorithm)
    return {
        robot: scorer.score_of(
            (*chosen.participants, robot),
            algorithm,
            share + float(gain),
            chosen.cost_bytes + scorer.size(robot, algorithm),
            chosen.cost + scorer.cost([robot], algorithm),
        )
        for robot, gain in zip(robots, union.gains(rows, counts[rows]), strict=True)
    }


def _weighing(
    scorer: Scorer, robot: str, decision: Decision, chosen: Score, joined: Mapping[str, Score]
) -> Weighing:
    """One candidate; `chosen` is the decision's own score, `joined` that with one more."""
    algorithm = decision.algorithm
    if not scorer.known(robot, algorithm):
        return Weighing(adds=None, costs=None, why="size")
    if not scorer.can(robot, algorithm):
        return Weighing(adds=None, costs=None, why="link")
    taken = robot in decision.participants
    others = [r for r in chosen.participants if r != robot]
    without = scorer.score(others, algorithm) if taken else chosen
    with_it = chosen if taken else joined[robot]
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


def _assigned(one: Brought | None, taken: bool) -> Weighing:
    """A candidate by what it brings to assignments; `taken`: it is among them."""
    if one is None:
        return Weighing(adds=None, costs=None, why="link")
    why: Verdict = "pays" if one.adds >= one.costs else "kept"
    if not taken:
        why = "fit" if not one.fits else "kept" if one.adds > one.costs else "costs"
    return Weighing(adds=round(one.adds, DIGITS), costs=round(one.costs, DIGITS), why=why)


def _other(compared: Compared, decision: Decision) -> Other | None:
    """The best of what was compared that has other participants or another algorithm."""
    scorer = compared.scorer
    same = (frozenset(decision.participants[1:]), decision.algorithm)
    options = [
        option
        for option in compared.options
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
