"""What the policy keeps of advice, and of the cycle that it is in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ego_agent.plan.advice.judge import Advised
from ego_agent.plan.advice.outcomes import Ended, Outcome, plain
from ego_agent.plan.advice.questions import Answered
from ego_agent.plan.choices.options import Compared
from ego_agent.plan.choices.scoring import Score, Scorer
from swarm.messages import AnswerReport, LlmTokens, Source


@dataclass(frozen=True, slots=True)
class Advice:
    """Advice that was adopted."""

    what: Advised
    reason: str
    """The model's own words."""
    model: str
    since_s: float
    """`time.monotonic()` seconds."""


@dataclass(slots=True)
class Cycle:
    """One call of `propose`: what it decides on, and what it finds out."""

    compared: Compared
    """What the fallback was chosen from."""
    fallback: Score
    fallback_reason: str
    now_s: float
    """`time.monotonic()` seconds."""
    gateway: bool
    fingerprint: str = ""
    answer: AnswerReport | None = None
    fresh: Source | None = None
    """Where advice that was adopted in this cycle came from."""
    notes: tuple[str, ...] = ()
    """What was repaired in it."""
    advised: Score | None = None
    """What the advice in force is worth now."""
    ended: Ended | None = None
    asked: bool = False

    @property
    def scorer(self) -> Scorer:
        """Of the scene."""
        return self.compared.scorer


def answer_report(
    heard: Answered, outcome: Outcome, why: str, repaired: Sequence[str] = ()
) -> AnswerReport:
    """What came of a question, as the journal has it."""
    answer = heard.answer
    return AnswerReport(
        question=heard.question.number,
        outcome=outcome,
        why=why,
        repaired=tuple(repaired),
        model=plain(answer.model, 200) if answer else "",
        source=answer.source if answer else "",
        latency_ms=round(heard.latency_s * 1e3, 3),
        tokens=answer.tokens if answer else LlmTokens(),
    )
