"""What a language model's advice is worth in the scene as it is now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ego_agent.knowledge.model import Proposal
from ego_agent.plan.advice.outcomes import Refused
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.validation import MAX_PARTICIPANTS, Unusable, validate
from ego_agent.plan.surrogate.estimate import Estimate
from ego_agent.plan.surrogate.model import Surrogate
from swarm.messages import Decision

_ROUNDING = 1e-9
"""Less is a rounding error, not a difference."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Advice that may be followed, or why it may not."""

    refused: Refused | None
    why: str = ""
    """In words, when it is refused."""
    participants: tuple[str, ...] = ()
    """After repair, the ego first."""
    algorithm: str = ""
    repaired: tuple[Refused, ...] = ()
    """Kinds of what had to be repaired."""
    notes: tuple[str, ...] = ()
    """What was repaired, in words."""
    score: Score | None = None
    """Of what remains, by the scorer; None when it is refused."""


def judge(
    participants: Sequence[str],
    algorithm: str,
    scorer: Scorer,
    fallback: Score,
    *,
    margin: float,
    surrogate: Surrogate | None = None,
) -> Verdict:
    """Whether to follow advice in the scorer's scene, where the fallback would choose `fallback`.

    What is unknown, cannot be fused or does not fit the link is repaired as in any proposal. What
    then remains must not be predicted to be worse than the fallback by more than `margin`: in value
    Q - lambda C where both reach Q_min, else in quality; never where only the fallback reaches it.
    The surrogate predicts Q of both, where there is one that knows both algorithms; else the scorer
    does.
    """
    scene = scorer.scene
    named = set(participants) - {scene.ego.robot}
    known = {name for name in named if name in scorer.row_of}
    proposal = Proposal(tuple(participants), algorithm, "", "llm")
    found = validate(proposal, scene, scorer.knowledge, policy="llm", cycle=0, now_ns=0)
    if isinstance(found, Unusable):
        if len(participants) > MAX_PARTICIPANTS:
            kind: Refused = "too_many"
        else:
            kind = "infeasible" if known else "unknown_robot"
        return Verdict(kind, found.why, notes=found.repairs)
    at = scorer.at_rate(found.rate_hz)
    scored = at.score(found.participants, found.algorithm)
    if scorer.knowledge.may_be_rarer(found.algorithm):
        # What is adopted gets rates of its own, as the fallback has.
        scored = Mixes(at).rated(scored.participants, found.algorithm)
    ours, theirs = scored, fallback
    if surrogate is not None and surrogate.knows(ours.algorithm, theirs.algorithm):
        estimate = Estimate(scorer, surrogate)
        ours = estimate.score(ours.participants, ours.algorithm)
        theirs = estimate.score(theirs.participants, theirs.algorithm)
    if why := _worse(scorer, ours, theirs, margin):
        return Verdict("worse", why, notes=found.repairs)
    repaired: list[Refused] = ["unknown_robot"] if named - known else []
    repaired += _repaired(at, known, algorithm, found)
    return Verdict(
        None, "", found.participants, found.algorithm, tuple(repaired), found.repairs, scored
    )


def _repaired(scorer: Scorer, known: set[str], algorithm: str, decision: Decision) -> list[Refused]:
    """Kinds of changes to what known robots were to do: another algorithm or a robot that cannot
    send for it is infeasible; else those left out were too many for the link."""
    dropped = known - set(decision.participants)
    unable = [robot for robot in dropped if not scorer.can(robot, decision.algorithm)]
    found: list[Refused] = []
    if decision.algorithm != algorithm or unable:
        found.append("infeasible")
    if len(dropped) > len(unable):
        found.append("too_many")
    return found


def _worse(scorer: Scorer, ours: Score, fallback: Score, margin: float) -> str:
    """Why the advice is worse than the fallback, or nothing."""
    good = scorer.good_enough(ours)
    if good and not scorer.good_enough(fallback):
        return ""
    if not good and scorer.good_enough(fallback):
        return (
            f"predicted quality {ours.quality:.3f}, the fallback has "
            f"{fallback.quality:.3f} and reaches {scorer.objective.q_min:.3f}"
        )
    what, mine, theirs = "quality", ours.quality, fallback.quality
    if good:
        what, mine, theirs = "value", ours.value, fallback.value
    if mine >= theirs - margin - _ROUNDING:
        return ""
    return f"predicted {what} {mine:.3f}, the fallback has {theirs:.3f}"
