"""How often each participant contributes, where memory carries on what it showed before.

Who takes part, and how, is decided by then. Of a set that is decided, what the objective expects is
a sum over its participants: each adds what the ones before it do not show, and costs its own link
and processors. So the best rate of each, for itself, is the best of all together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.union import Union
from swarm.messages import Algorithm, Assignment, Decision

CARRIED_S = 1.1
"""In this time of mean age, what memory carries on of a contribution loses two thirds of its worth:
measured on eight floors (docs/results.md)."""
SAME = 0.002
"""A rate stays where another one is better by no more than this, in quality."""


@dataclass(frozen=True, slots=True)
class _Part:
    """One participant's part of a decision."""

    robot: str
    gain: float
    """Quality that it adds in every fused frame."""
    cost: float
    """lambda C of that, in quality."""
    size: int
    """Bytes of one contribution."""


def assigned(
    decision: Decision, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
) -> Decision:
    """The decision with a rate for each participant, and with the quality and the bytes a frame
    that follow; as it was where the objective has no rarer rates, or nobody contributes.

    The rates are never above the decision's own, so a link that carries the decision carries this,
    and never one that sends it two contributions in a frame.
    """
    usual_hz = decision.rate_hz
    rates = [usual_hz, *(hz for hz in knowledge.objective.rarer_hz if hz < usual_hz)]
    others = [robot for robot in decision.participants if robot != decision.ego]
    if len(rates) == 1 or not others:
        return decision
    at = Scorer(scene, knowledge).at_rate(usual_hz)
    before = {
        one.robot: one.rate_hz
        for one in (previous.assignments if previous else ())
        if one.algorithm == decision.algorithm
    }
    chosen: list[Assignment] = []
    lost, saved = 0.0, 0.0
    for part in _parts(at, others, decision.algorithm):
        worth = {hz: part.gain * kept(hz, usual_hz) - part.cost * hz / usual_hz for hz in rates}
        best = max(rates, key=lambda hz: (worth[hz], hz))
        held = before.get(part.robot)
        if held in worth and worth[held] >= worth[best] - SAME:
            best = held
        chosen.append(Assignment(robot=part.robot, algorithm=decision.algorithm, rate_hz=best))
        lost += part.gain * (1.0 - kept(best, usual_hz))
        saved += part.size * (1.0 - best / usual_hz)
    if all(one.rate_hz == usual_hz for one in chosen):
        return decision
    order = {robot: place for place, robot in enumerate(others)}
    return msgspec.structs.replace(
        decision,
        assignments=tuple(sorted(chosen, key=lambda one: order[one.robot])),
        quality=max(0.0, decision.quality - lost),
        cost_bytes=max(0, decision.cost_bytes - round(saved)),
        reason=f"{decision.reason} {_told(chosen, usual_hz)}",
    )


def kept(rate_hz: float, usual_hz: float) -> float:
    """What contributions at a rate are worth against those in every fused frame, in (0, 1]:
    exp(-(a - a0) / CARRIED_S), where a = 1 / (2 rate) is their mean age."""
    return math.exp(-(1.0 / rate_hz - 1.0 / usual_hz) / (2.0 * CARRIED_S))


def _parts(scorer: Scorer, robots: list[str], algorithm: Algorithm) -> list[_Part]:
    """What each adds beside those before it, the one that adds most first."""
    union, share = Union(scorer.views), scorer.own_share
    arrival = scorer.arrival(algorithm)
    left = np.array([scorer.row_of[robot] for robot in robots], dtype=np.intp)
    quality = scorer.quality(algorithm, share, len(robots))
    parts = []
    while len(left):
        gains = union.gains(left, arrival[left])
        place = int(np.argmax(gains))
        row = int(left[place])
        share += float(gains[place])
        union.add(row, float(arrival[row]))
        left = np.delete(left, place)
        candidate = scorer.scene.candidates[row - 1]
        now = scorer.quality(algorithm, share, len(robots))
        parts.append(
            _Part(
                candidate.robot,
                max(0.0, now - quality),
                scorer.price(row, algorithm),
                candidate.sizes[algorithm],
            )
        )
        quality = now
    return parts


def _told(chosen: list[Assignment], usual_hz: float) -> str:
    """Who is asked less often, in one sentence."""
    rarer: dict[float, list[str]] = {}
    for one in chosen:
        if one.rate_hz < usual_hz:
            rarer.setdefault(one.rate_hz, []).append(one.robot)
    parts = [
        f"{len(robots)} of {len(chosen)} send {hz:g} times a second"
        for hz, robots in sorted(rarer.items(), reverse=True)
    ]
    return f"Memory carries on what they showed: {', '.join(parts)}."
