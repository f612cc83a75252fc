"""What a language model's advice is worth in the scene as it is now."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ego_agent.knowledge.model import Proposal
from ego_agent.plan.advice.outcomes import Refused
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.validation import (
    MAX_PARTICIPANTS,
    Unusable,
    bounded,
    shown,
    validate,
)
from ego_agent.plan.surrogate.estimate import Estimate
from ego_agent.plan.surrogate.model import Surrogate
from swarm.messages import MIXED, Algorithm, Decision

_ROUNDING = 1e-9
"""Less is a rounding error, not a difference."""


@dataclass(frozen=True, slots=True)
class Advised:
    """Who is to take part, the ego first, and how."""

    participants: Sequence[str]
    algorithm: str
    forms: Mapping[str, Algorithm] = field(default_factory=dict)
    """By which algorithm each robot sends, where that differs."""


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

    @property
    def forms(self) -> Mapping[str, Algorithm]:
        """By which algorithm each robot sends, where that differs."""
        if self.score is None or self.score.algorithm != MIXED:
            return {}
        return self.score.sends


def judge(
    advice: Advised,
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
    found = repaired(advice, scorer)
    scored = found.score
    if found.refused is not None or scored is None:
        return found
    ours, theirs = scored, fallback
    if surrogate is not None and surrogate.knows(ours.algorithm, theirs.algorithm):
        estimate = Estimate(scorer, surrogate)
        ours = estimate.score(ours.participants, ours.algorithm)
        theirs = estimate.score(theirs.participants, theirs.algorithm)
    if why := _worse(scorer, ours, theirs, margin):
        return Verdict("worse", why, notes=found.notes)
    return found


def repaired(advice: Advised, scorer: Scorer) -> Verdict:
    """Advice as far as it can be carried out, each robot as often as is best, whatever that is
    worth; refused where nothing remains."""
    scene, mixable = scorer.scene, scorer.objective.rarer_hz and scorer.knowledge.mixable
    named = set(advice.participants) - {scene.ego.robot}
    known = {name for name in named if name in scorer.row_of}
    if advice.forms and known and mixable:
        return _mixed(advice.forms, scorer)
    proposal = Proposal(tuple(advice.participants), advice.algorithm, "", "llm")
    found = validate(proposal, scene, scorer.knowledge, policy="llm", cycle=0, now_ns=0)
    if isinstance(found, Unusable):
        if len(advice.participants) > MAX_PARTICIPANTS:
            kind: Refused = "too_many"
        else:
            kind = "infeasible" if known else "unknown_robot"
        return Verdict(kind, found.why, notes=found.repairs)
    at = scorer.at_rate(found.rate_hz)
    scored = at.score(found.participants, found.algorithm)
    if scorer.knowledge.may_be_rarer(found.algorithm):
        # What is adopted gets rates of its own, as the fallback has.
        scored = Mixes(at).rated(scored.participants, found.algorithm)
    kinds: list[Refused] = ["unknown_robot"] if named - known else []
    kinds += _repaired(at, known, advice.algorithm, found)
    return Verdict(
        None, "", found.participants, found.algorithm, tuple(kinds), found.repairs, scored
    )


def _mixed(forms: Mapping[str, Algorithm], scorer: Scorer) -> Verdict:
    """The same of robots that are to send different things."""
    mixes = Mixes(scorer)
    known = {robot: name for robot, name in forms.items() if robot in scorer.row_of}
    able = {robot: name for robot, name in known.items() if mixes.sends(robot, name)}
    score = mixes.rated_as(able)
    kinds: list[Refused] = []
    notes: list[str] = []
    for robot, name in forms.items():
        if robot not in known:
            kind: Refused = "unknown_robot"
            why = scorer.scene.excluded.get(robot, "no such robot is known")
        elif robot not in able:
            kind, why = "infeasible", f"it cannot send {name}"
        elif robot not in score.participants:
            kind, why = "too_many", "it does not fit beside the others, or adds nothing to them"
        else:
            continue
        kinds.append(kind)
        notes.append(f"dropped {shown(robot)}: {why}")
    if not score.participants:
        why = "nobody of those it names fits the link and adds anything"
        return Verdict("infeasible", why, notes=bounded(notes))
    participants = (scorer.scene.ego.robot, *score.participants)
    return Verdict(
        None, "", participants, score.algorithm, tuple(dict.fromkeys(kinds)), bounded(notes), score
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
