"""How often each participant of a decision contributes, where the policy has not said so.

Who takes part, and how, is decided by then: memory carries on what those show who are asked less
often (choices/mixes.py).
"""

from __future__ import annotations

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.pace import often
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from swarm.messages import Assignment, Decision

SAME = 0.002
"""Rates stay where others are better by no more than this, in value."""


def assigned(
    decision: Decision, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
) -> Decision:
    """The decision with a rate for each participant, and with the quality and the bytes a frame
    that follow; as it was where the objective has no rarer ones, where the algorithm cannot be
    fused beside others, or where nobody contributes. The rates are those of the decision before
    where others are hardly better."""
    others = decision.participants[1:]
    if not others or not knowledge.may_be_rarer(decision.algorithm):
        return decision
    mixes = Mixes(Scorer(scene, knowledge).at_rate(decision.rate_hz))
    found = steady(mixes, mixes.rated(others, decision.algorithm), previous)
    if not found.assignments:
        return decision
    order = {robot: place for place, robot in enumerate(others)}
    return msgspec.structs.replace(
        decision,
        assignments=tuple(sorted(found.assignments, key=lambda one: order[one.robot])),
        quality=found.quality,
        cost_bytes=found.cost_bytes,
        reason=f"{decision.reason} {told(found.assignments, decision.rate_hz)}",
    )


def steady(mixes: Mixes, found: Score, previous: Decision | None) -> Score:
    """A choice with the rates of the decision before, where the same robots send the same in both
    and others are hardly better."""
    if previous is None or previous.rate_hz != found.pace.rate_hz:
        return found
    if {one.robot: one.algorithm for one in previous.assignments} != found.sends:
        return found
    held = mixes.score(previous.assignments)
    if held is None or held.value < found.value - SAME or not mixes.passes(held):
        return found
    return held


def told(chosen: tuple[Assignment, ...], usual_hz: float) -> str:
    """Who is asked less often, in one sentence."""
    rarer: dict[float, list[str]] = {}
    for one in chosen:
        if one.rate_hz < usual_hz:
            rarer.setdefault(one.rate_hz, []).append(one.robot)
    parts = [
        f"{len(robots)} of {len(chosen)} send {often(hz)}"
        for hz, robots in sorted(rarer.items(), reverse=True)
    ]
    if not parts:
        return ""
    text = f"Memory carries on what they showed: {', '.join(parts)}"
    if between := {one.places_hz for one in chosen if one.places_hz > 0.0}:
        fewer = f"{min(between):g} to " if len(between) > 1 else ""
        text += f", and {fewer}{often(max(between))} in between what they see where something is "
        text += "remembered"
    return f"{text}."
