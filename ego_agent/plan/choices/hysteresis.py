"""The best of several options, unless the decision in force is as good."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from ego_agent.knowledge.learnt import ANOTHER_LINK
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from swarm.messages import Decision

ARRIVES = 0.5
"""Of a decision whose contributions are in time less often than this, on average, nothing comes."""
MORE_HEARD = 2
"""Where more than this many times as many robots may take part as in the cycle before, because they
are heard again, what was chosen of those few need not stand."""
_Sends = tuple[str, str, float]
MAX_CYCLE_S = 5.0
"""A decision is taken to have been in force no longer than this until the next one, however the
clock jumps."""


def best_option(scorer: Scorer, options: Sequence[Score]) -> Score:
    """The best value among the options that reach Q_min; the best quality where none does."""
    good = [option for option in options if scorer.good_enough(option)]
    if good:
        return min(good, key=lambda o: (-o.value, o.cost_bytes, o.participants))
    return min(options, key=lambda o: (-o.quality, o.cost_bytes, o.participants))


def still_possible(
    scorer: Scorer, previous: Decision | None, mixes: Mixes | None = None
) -> Score | None:
    """The decision in force with those of its robots that can go on, scored in the new scene.

    None where it cannot be carried on: nobody is left of those that it chose. A robot that drops
    out is no reason to choose algorithm, rate and the others anew. `mixes`: the scorer's options,
    where what robots send may differ.
    """
    if previous is not None and previous.assignments and mixes is not None:
        return _still_assigned(mixes, previous)
    if previous is None or previous.algorithm not in scorer.knowledge.algorithms:
        return None
    scorer = scorer.at_rate(previous.rate_hz)
    if scorer.pace.rate_hz != previous.rate_hz:
        return None
    chosen = [robot for robot in previous.participants if robot != scorer.scene.ego.robot]
    others = [robot for robot in chosen if scorer.can(robot, previous.algorithm)]
    if chosen and not others:
        return None
    score = scorer.score(others, previous.algorithm)
    return score if scorer.fits(score) else None


def _still_assigned(mixes: Mixes, previous: Decision) -> Score | None:
    """The same of a decision with assignments."""
    if mixes.scorer.pace.rate_hz != previous.rate_hz:
        scorer = mixes.scorer.at_rate(previous.rate_hz)
        if scorer.pace.rate_hz != previous.rate_hz:
            return None
        mixes = Mixes(scorer)
    able = [one for one in previous.assignments if mixes.can(one)]
    if not able:
        return None
    score = mixes.score(able)
    return score if score is not None and mixes.carries(score) else None


def settle(
    scorer: Scorer, options: Sequence[Score], best: Score, held: Score, previous: Decision
) -> Score:
    """Keeps the decision in force unless a change pays, so that decisions do not flap.

    A change must gain `switch_gain`; one that costs more must also leave `upgrade_reserve` of the
    budget free, so that a small drop of C(t) does not undo it at once; and the decision in force
    must be `dwell_s` old, unless the link has changed, many robots are heard again at once, or a
    robot has dropped out, whose place another may take at once. Reaching Q_min goes before all of
    them, and so does leaving a decision that brings nothing. `held` is the score of `previous` as
    it is now.
    """
    objective = scorer.objective
    if _dwells(scorer, previous) and not _pressing(scorer, best, held):
        if len(held.participants) + 1 == len(previous.participants):
            return held
        options = [held, *(o for o in options if {*o.participants} - {*previous.participants})]
        best = best_option(scorer, options)
    if scorer.good_enough(best) and not scorer.good_enough(held):
        return best
    best = best_option(scorer, [o for o in options if _roomy(scorer, o, held)])
    if not scorer.good_enough(held):
        gain = best.quality - held.quality
    elif scorer.good_enough(best):
        gain = best.value - held.value
    else:
        return held
    return best if gain > objective.switch_gain else held


def _roomy(scorer: Scorer, option: Score, held: Score) -> bool:
    """Whether an option costs no more than what is held, or leaves the reserve."""
    budget = scorer.at(option.pace).budget_bytes
    free = budget * (1.0 - scorer.objective.upgrade_reserve)
    cheaper = option.cost_bytes * option.pace.rate_hz <= held.cost_bytes * held.pace.rate_hz
    return cheaper or option.cost_bytes <= free


def _dwells(scorer: Scorer, previous: Decision) -> bool:
    """Whether a decision is too new to be changed for a gain. One of unknown age is not."""
    if previous.held_s is None or previous.held_s >= scorer.objective.dwell_s:
        return False
    candidates = scorer.scene.candidates
    back = sum(candidate.robot in previous.excluded for candidate in candidates)
    if len(candidates) > MORE_HEARD * (len(candidates) - back):
        return False
    change = scorer.scene.capacity_bps / previous.capacity_bps
    return 1.0 / ANOTHER_LINK < change < ANOTHER_LINK


def _pressing(scorer: Scorer, best: Score, held: Score) -> bool:
    """Whether what is held cannot wait for its time to be over."""
    lost = scorer.objective.q_min - scorer.objective.switch_gain
    if scorer.good_enough(best) and held.quality < lost:
        return True
    if not held.participants:
        return bool(best.participants)
    at = scorer.at(held.pace)
    chances = [at.in_time(robot, held.algorithm_of(robot)) for robot in held.participants]
    return sum(chances) < ARRIVES * len(chances)


def held(decision: Decision, previous: Decision | None, now_ns: int) -> Decision:
    """The decision with the time for which it has been in force."""
    if previous is None or _choice(decision) != _choice(previous):
        return msgspec.structs.replace(decision, held_s=0.0)
    elapsed_s = (now_ns - previous.decided_ns) * 1e-9
    held_s = (previous.held_s or 0.0) + min(MAX_CYCLE_S, max(0.0, elapsed_s))
    return msgspec.structs.replace(decision, held_s=held_s)


def _choice(decision: Decision) -> tuple[frozenset[str], str, float, frozenset[_Sends]]:
    """What a change of a decision changes; what a robot that is asked for a part sends may turn
    out otherwise."""
    rates = frozenset((one.robot, one.algorithm, one.rate_hz) for one in decision.assignments)
    return frozenset(decision.participants), decision.algorithm, decision.rate_hz, rates
