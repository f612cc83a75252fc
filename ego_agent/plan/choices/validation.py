"""Validation: nothing that a policy proposes is carried out unchecked.

Offenders are dropped, the ego is put first, an algorithm that cannot be used or does not fit the
link is replaced, participants that the link cannot carry are dropped; every change is recorded as
a sentence. What cannot be repaired is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.plan.choices.check_assignments import carried
from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from swarm.messages import AdviceReport, Algorithm, Decision, Source

SOURCES: tuple[Source, ...] = get_args(Source)
MAX_REASON = 500
MAX_MODEL = 200
MAX_NAME = 40
MAX_REPAIRS = 16
MAX_PARTICIPANTS = 1024
"""Names read from one proposal: more than any swarm has, so that a flood costs little."""


@dataclass(frozen=True, slots=True)
class Unusable:
    """A proposal that cannot be repaired."""

    why: str
    changed: tuple[str, ...] = ()
    """What was tried, one sentence each."""

    @property
    def repairs(self) -> tuple[str, ...]:
        """The whole story, for `Decision.repairs`."""
        return bounded([*self.changed, f"refused: {self.why}"])


def validate(
    proposal: Proposal,
    scene: UnifiedScene,
    knowledge: Knowledge,
    *,
    policy: str,
    cycle: int,
    now_ns: int,
) -> Decision | Unusable:
    """A valid decision made from the proposal; its `repairs` say what was changed.

    A decision is valid when its participants are the ego, first, and candidates of the scene, each
    once; its algorithm is available and everyone's size for it is known; and
    C(P, a) * 8 * rate <= headroom * C(t), at the rate that is decided, and the same for each one's
    size and its own link, or the ego is alone. Where robots differ in what they send and how often,
    C(P, a) is the mean of a frame.
    """
    repairs: list[str] = []
    if trouble := _unusable(proposal, knowledge, now_ns):
        return Unusable(trouble)
    repairs.extend(proposal.notes)
    fastest = Scorer(scene, knowledge)
    asked = _known_once(proposal.participants, scene, repairs)
    if not asked and any(name != scene.ego.robot for name in proposal.participants):
        return Unusable("nobody of those it names can take part", tuple(repairs))
    if proposal.assignments and knowledge.objective.rarer_hz:
        scorer = fastest.at_rate(proposal.rate_hz)
        score = carried(scorer, asked, proposal.assignments, repairs)
    else:
        scorer = _paced(fastest, asked, proposal)
        score = _carried(scorer, asked, proposal.algorithm, repairs)
    if asked and not score.participants:
        why = "nobody of those it names fits the link and adds anything"
        return Unusable(why, tuple(repairs))
    source = proposal.source
    if source not in SOURCES:
        repairs.append(f"source {shown(source)} is unknown: taken as policy")
        source = "policy"
    return make_decision(
        scorer,
        score,
        reason=proposal.reason,
        source=source,
        repairs=repairs,
        policy=policy,
        cycle=cycle,
        now_ns=now_ns,
        model=proposal.model,
        advice=proposal.advice,
    )


def make_decision(
    scorer: Scorer,
    score: Score,
    *,
    reason: object,
    source: Source,
    repairs: Sequence[str],
    policy: str,
    cycle: int,
    now_ns: int,
    model: object = "",
    advice: AdviceReport | None = None,
) -> Decision:
    """The message of a choice that has been checked, by a scorer of its scene."""
    ego = scorer.scene.ego.robot
    at = scorer.at(score.pace)
    return Decision(
        ego=ego,
        cycle=cycle,
        decided_ns=now_ns,
        participants=(ego, *score.participants),
        algorithm=score.algorithm,
        reason=_text(reason, MAX_REASON),
        source=source,
        policy=policy,
        model=_text(model, MAX_MODEL),
        valid=ego not in scorer.scene.excluded,
        repairs=bounded(repairs),
        quality=score.quality,
        cost_bytes=score.cost_bytes,
        rate_hz=score.pace.rate_hz,
        capacity_bps=scorer.scene.capacity_bps,
        advice=advice,
        deadline_s=score.pace.deadline_s,
        arrival={
            robot: round(at.in_time(robot, score.algorithm_of(robot)), 3)
            for robot in score.participants
        },
        assignments=score.assignments,
    )


def bounded(repairs: Sequence[str]) -> tuple[str, ...]:
    """The first and the last sentence and what fits between them, fit for UTF-8."""
    texts = [_text(sentence, MAX_REASON) for sentence in repairs]
    if len(texts) > MAX_REPAIRS:
        left_out = len(texts) - MAX_REPAIRS + 1
        texts = [*texts[: MAX_REPAIRS - 2], f"and {left_out} more changes", texts[-1]]
    return tuple(texts)


def shown(value: object) -> str:
    """A value from outside as it may stand in a sentence: text quoted and cut, else its type."""
    return repr(value[:MAX_NAME]) if isinstance(value, str) else f"of type {type(value).__name__}"


def _text(value: object, length: int) -> str:
    """Text from outside, cut and fit for UTF-8; empty for anything but text."""
    if not isinstance(value, str):
        return ""
    return value[:length].encode("utf-8", "replace").decode("utf-8")


def _unusable(proposal: Proposal, knowledge: Knowledge, now_ns: int) -> str | None:
    """Why a proposal is refused unread, or None. Its types are checked: it may be anything."""
    limit_s = knowledge.objective.proposal_max_age_s
    if not isinstance(proposal, Proposal):
        return f"a proposal {shown(proposal)}"
    if not isinstance(proposal.participants, tuple | list):
        return f"participants {shown(proposal.participants)}, not a list of robot ids"
    if len(proposal.participants) > MAX_PARTICIPANTS:
        number = len(proposal.participants)
        return f"{number} participants, at most {MAX_PARTICIPANTS} are allowed"
    if proposal.made_ns is not None and now_ns - proposal.made_ns > limit_s * 1e9:
        age_s = (now_ns - proposal.made_ns) / 1e9
        return f"it is {age_s:.1f} s old, at most {limit_s:.1f} s is allowed"
    return None


def _known_once(names: Sequence[object], scene: UnifiedScene, repairs: list[str]) -> list[str]:
    """The named candidates, each once and without the ego; the rest is recorded as dropped."""
    ego = scene.ego.robot
    candidates = {c.robot for c in scene.candidates}
    seen: set[str] = set()
    kept: list[str] = []
    for name in names:
        if not isinstance(name, str):
            repairs.append(f"dropped a participant {shown(name)}: not a robot id")
        elif name in seen:
            repairs.append(f"dropped {shown(name)}: named twice")
        elif name not in candidates and name != ego:
            why = scene.excluded.get(name, "no such robot is known")
            repairs.append(f"dropped {shown(name)}: {why}")
        elif name in candidates:
            kept.append(name)
        if isinstance(name, str):
            seen.add(name)
    if ego not in seen:
        repairs.append("added the ego, which always takes part")
    elif names[0] != ego:
        repairs.append("put the ego first")
    return kept


def _carried(scorer: Scorer, asked: list[str], wanted: object, repairs: list[str]) -> Score:
    """The choice as proposed, or the nearest one that can be fused and that the link can carry."""
    knowledge = scorer.knowledge
    algorithm = next((name for name in knowledge.algorithms if name == wanted), None)
    if algorithm is None:
        available = ", ".join(knowledge.algorithms)
        repairs.append(f"algorithm {shown(wanted)} is not available: only {available}")
        if not asked:
            return scorer.score((), knowledge.best_algorithm())
        best = _better(scorer, [_trimmed(scorer, asked, name) for name in knowledge.algorithms])
        repairs.append(f"took {best.algorithm} fusion instead")
    else:
        best = _trimmed(scorer, asked, algorithm)
        if len(best.participants) < len(asked):
            cheaper = [a for a in knowledge.algorithms if _costs_less(scorer, asked, a, algorithm)]
            best = _better(scorer, [best, *(_trimmed(scorer, asked, a) for a in cheaper)])
            if best.algorithm != algorithm:
                repairs.append(_why_cheaper(scorer, asked, algorithm, best))
    for robot in asked:
        if robot not in best.participants:
            repairs.append(f"dropped {robot}: {_why_dropped(scorer, robot, best)}")
    return best


def _paced(fastest: Scorer, asked: list[str], proposal: Proposal) -> Scorer:
    """At the pace that was proposed, or else at the one that suits the choice best, with each robot
    as often as it is worth; a slower one must gain `switch_gain`."""
    if proposal.rate_hz is not None or proposal.algorithm not in fastest.knowledge.algorithms:
        return fastest.at_rate(proposal.rate_hz)
    taken, best = fastest, _value(fastest, asked, proposal.algorithm)
    for pace in fastest.paces[1:]:
        slower = fastest.at(pace)
        value = _value(slower, asked, proposal.algorithm)
        if value > best + fastest.objective.switch_gain:
            taken, best = slower, value
    return taken


def _value(scorer: Scorer, asked: list[str], algorithm: Algorithm) -> float:
    """Of the choice at the scorer's pace, with rates where robots may be asked less often."""
    trimmed = _trimmed(scorer, asked, algorithm)
    rarer = scorer.knowledge.may_be_rarer(algorithm)
    if not trimmed.participants or trimmed.assignments or not rarer:
        return trimmed.value
    return max(trimmed.value, Mixes(scorer).rated(trimmed.participants, algorithm).value)


def _trimmed(scorer: Scorer, asked: list[str], algorithm: Algorithm) -> Score:
    """Those who can send for the algorithm; where the link cannot carry them all in every frame,
    the ones with the least gain a byte are left out, or all are asked less often where that may be
    and is worth more."""
    able = [robot for robot in asked if scorer.can(robot, algorithm)]
    trimmed = scorer.score(able, algorithm)
    if not scorer.fits(trimmed):
        wanted = tuple(c for c in scorer.scene.candidates if c.robot in able)
        grown = [scorer.score((), algorithm), *grow(scorer, wanted, algorithm, by_byte=True)]
        trimmed = grown[-1]
    if len(trimmed.participants) == len(asked) or not scorer.knowledge.may_be_rarer(algorithm):
        return trimmed
    mixes = Mixes(scorer)
    some = [robot for robot in asked if mixes.sends(robot, algorithm)]
    rated = [mixes.rated(robots, algorithm) for robots in (some, trimmed.participants)]
    return _better(scorer, [*rated, trimmed])


def _costs_less(scorer: Scorer, asked: list[str], one: Algorithm, other: Algorithm) -> bool:
    """Whether those whose sizes of both forms are known send fewer bytes in the one."""
    both = [r for r in asked if scorer.known(r, one) and scorer.known(r, other)]
    return sum(scorer.size(r, one) - scorer.size(r, other) for r in both) < 0


def _better(scorer: Scorer, scores: list[Score]) -> Score:
    """The best of some choices: rather with participants, rather with Q_min, then by value."""
    return max(
        scores,
        key=lambda s: (
            bool(s.participants),
            scorer.good_enough(s),
            s.value if scorer.good_enough(s) else s.quality,
        ),
    )


def _why_cheaper(scorer: Scorer, asked: list[str], wanted: Algorithm, taken: Score) -> str:
    """Why another algorithm was taken; names those whose own links are too narrow for the first."""
    narrow = [
        f"{robot}: {_own_link(scorer, robot, wanted)}"
        for robot in asked
        if scorer.known(robot, wanted) and not scorer.can(robot, wanted)
    ]
    why = "; ".join(narrow) or f"{wanted} does not carry all that were named"
    return f"took {taken.algorithm} fusion: {why}"


def _own_link(scorer: Scorer, robot: str, algorithm: Algorithm) -> str:
    return (
        f"{scorer.size(robot, algorithm) / 1e3:.1f} kB a frame for {algorithm} need "
        f"{scorer.needs_bps(robot, algorithm) / 1e6:.2f} Mbit/s, its own link may carry "
        f"{scorer.allowed_bps(robot) / 1e6:.2f}"
    )


def _why_dropped(scorer: Scorer, robot: str, score: Score) -> str:
    if not scorer.known(robot, score.algorithm):
        return f"the size of its {score.algorithm} observation is not known"
    if not scorer.can(robot, score.algorithm):
        return _own_link(scorer, robot, score.algorithm)
    size = scorer.size(robot, score.algorithm)
    if score.cost_bytes + size <= scorer.budget_bytes:
        return "it adds nothing to what the others see, and not all fit the link"
    return (
        f"its {size / 1e3:.1f} kB a frame do not fit beside {score.cost_bytes / 1e3:.1f} of "
        f"{scorer.budget_bytes / 1e3:.1f} kB"
    )
