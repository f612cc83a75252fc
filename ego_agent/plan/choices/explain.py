"""What stood to be chosen in a scene, for people and for experiments."""

from __future__ import annotations

import math
from typing import Any

from ego_agent.knowledge.answers import UNTRIED
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Candidate, UnifiedScene
from ego_agent.knowledge.weighed import Weighing
from ego_agent.plan.choices.mixes import Brought, Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.weigh import weighings
from swarm.messages import Decision

TOLD_FRAMES = 3.0
"""Frames of evidence from which it is worth telling."""
TOLD_BELOW = 0.9
"""Who is in time more often than this is not told about."""


def explain(
    scene: UnifiedScene, knowledge: Knowledge, decision: Decision | None = None
) -> dict[str, Any]:
    """Plain values, ready for JSON: the budget in bytes a frame, the number of merged objects, each
    candidate's distance in metres, sizes in bytes (of whole contributions, and on average where
    only what may be an object is asked for), width of its own link in bit/s (None: as wide as the
    cell) and share of all that is seen (alone, and beyond what the ego sees), how its answers take
    by algorithm, and why the others are excluded. With a decision also what each candidate brings
    to it or would bring, what that costs, and why it is in or out."""
    scorer = Scorer(scene, knowledge)
    parts = {} if decision is None else _parts(scorer.at_rate(decision.rate_hz), decision)
    ego_share = scorer.share([0])
    rates = knowledge.rates
    of_objects = rates.with_places if rates.objects_from_hz > 0.0 else ()
    return {
        "budget_bytes": scorer.budget_bytes,
        "algorithms": {name: knowledge.quality.gain(name) for name in knowledge.algorithms},
        "objects": len(scene.objects),
        "ego_share": round(ego_share, 4),
        "candidates": [
            {
                "robot": candidate.robot,
                "distance_m": round(candidate.distance_m, 2),
                "sizes": dict(candidate.sizes),
                "objects_sizes": {
                    name: candidate.contribution_size(name, objects_only=True)
                    for name in candidate.sizes
                    if name in of_objects and candidate.sends_objects(name)
                },
                "capacity_bps": candidate.capacity_bps
                if math.isfinite(candidate.capacity_bps)
                else None,
                "answers": _answers(scorer, candidate),
                "placed": round(candidate.placed, 3),
                "share": round(scorer.share([row]), 4),
                "adds_to_ego": round(scorer.share([0, row]) - ego_share, 4),
                **parts.get(candidate.robot, {}),
            }
            for row, candidate in enumerate(scene.candidates, start=1)
        ],
        "excluded": dict(scene.excluded),
    }


def _parts(scorer: Scorer, decision: Decision) -> dict[str, dict[str, Any]]:
    """What each candidate brings to the decision beside its other participants, and what it costs,
    both in quality; None where it cannot send for the algorithm. `scorer`: at its pace."""
    if decision.assignments:
        brought = Mixes(scorer).brought(decision.assignments)
        return {
            c.robot: _assigned_part(brought.get(c.robot), c.robot in decision.participants)
            for c in scorer.scene.candidates
        }
    chosen, found = weighings(scorer, decision)
    return {robot: _part(scorer, robot, decision, chosen, one) for robot, one in found.items()}


def _part(
    scorer: Scorer, robot: str, decision: Decision, chosen: Score, found: Weighing
) -> dict[str, Any]:
    """One candidate's part where all send the same; `chosen` is the decision's own score."""
    algorithm = decision.algorithm
    taken = robot in decision.participants
    worth = f"adds {found.adds:.3f} and costs {found.costs:.3f}" if found.adds is not None else ""
    words = {
        "size": f"out: it cannot send for {algorithm}",
        "link": f"out: it cannot send for {algorithm}",
        "pays": f"in: it {worth}",
        "q_min": f"in: it {worth}, which Q_min takes",
        "costs": f"out: it {worth}",
        "kept": f"{'in' if taken else 'out'}: it {worth}, and no change pays yet",
    }
    why = words.get(found.why, "")
    if found.why == "fit":
        size_kb, free_kb = scorer.size(robot, algorithm) / 1e3, scorer.budget_bytes / 1e3
        taken_kb = chosen.cost_bytes / 1e3
        why = f"out: its {size_kb:.1f} kB do not fit beside {taken_kb:.1f} of {free_kb:.1f} kB"
    return {"chosen": taken, "adds": found.adds, "costs": found.costs, "why": why}


def _assigned_part(part: Brought | None, chosen: bool) -> dict[str, Any]:
    """The same where robots differ in what they send, and how often; of one that sends nothing,
    what it would bring with the option that is worth most."""
    if part is None:
        return {"chosen": chosen, "adds": None, "costs": None, "why": "out: it cannot send"}
    one, adds, costs = part.sends, part.adds, part.costs
    what = f"{one.algorithm}, objects only," if one.objects_only else one.algorithm
    worth = f"{what} {one.rate_hz:g} times a second adds {adds:.3f} and costs {costs:.3f}"
    why = f"in: {worth}"
    if not chosen:
        why = f"out: {worth}" + ("" if part.fits else ", and does not fit beside the others")
    return {"chosen": chosen, "adds": round(adds, 4), "costs": round(costs, 4), "why": why}


def told(scorer: Scorer) -> str:
    """Half a sentence about whom little is had of: see `_late` and `_unplaced`."""
    return "; ".join(part for part in (_late(scorer), _unplaced(scorer)) if part)


def _unplaced(scorer: Scorer) -> str:
    """About the robot of which most is left out, as nothing shows where it belongs."""
    found = [(c.placed, c.robot) for c in scorer.scene.candidates if c.placed < TOLD_BELOW]
    if not found:
        return ""
    placed, robot = min(found)
    more = f" (and of {len(found) - 1} more)" if len(found) > 1 else ""
    return f"{100 * (1 - placed):.0f} % of what {robot} sends cannot be laid in its place{more}"


def _late(scorer: Scorer) -> str:
    """About the robot that is in time least often, by algorithm, where anybody is known to be late;
    at the scorer's pace."""
    late: list[tuple[float, str, str]] = []
    for candidate in scorer.scene.candidates:
        chances = {
            name: scorer.in_time(candidate.robot, name)
            for name in scorer.knowledge.algorithms
            if candidate.answers.get(name, UNTRIED).frames >= TOLD_FRAMES
        }
        if chances and min(chances.values()) < TOLD_BELOW:
            shares = ", ".join(f"{100 * p:.0f} % of {name}" for name, p in chances.items())
            sentence = f"{candidate.robot} arrives in time in {shares}"
            late.append((min(chances.values()), candidate.robot, sentence))
    if not late:
        return ""
    sentence = min(late)[2]
    return sentence + (f" (and {len(late) - 1} more are late)" if len(late) > 1 else "")


def _answers(scorer: Scorer, candidate: Candidate) -> dict[str, Any]:
    """What is known of a robot's answers: the probability to be in time at each pace, seconds
    (`work_s`: of a processor, to encode), the share that never came, and frames of its own
    evidence."""
    return {
        name: {
            "in_time": {
                f"{pace.rate_hz:g}": round(answers.in_time(pace.deadline_s), 3)
                for pace in scorer.paces
            },
            "encode_s": _rounded(answers.encode_s),
            "work_s": _rounded(answers.work_s),
            "transfer_s": _rounded(answers.transfer_s),
            "lost": round(answers.lost, 3),
            "frames": round(answers.frames, 1),
        }
        for name, answers in candidate.answers.items()
    }


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 4)
