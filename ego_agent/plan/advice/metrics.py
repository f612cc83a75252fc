"""Prometheus metrics of the policy that asks a language model. Labels come from fixed sets."""

from __future__ import annotations

import math

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from ego_agent.plan.advice.outcomes import ENDED, OUTCOMES
from swarm.messages import AdviceReport
from swarm.metrics import start_at_zero

_BUCKETS = (0.005, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0, 60.0, 120.0)
_TOKENS = ("prompt", "reused", "output")


class AdviceMetrics:
    """Counts what the journal's lines say; shows what is in force."""

    def __init__(self, registry: CollectorRegistry) -> None:
        self.questions = Counter(
            "coadapt_ego_questions_total",
            "Questions to a language model.",
            registry=registry,
        )
        self.outcomes = Counter(
            "coadapt_ego_advice_total",
            "What came of questions: adopted, or why not.",
            ["outcome"],
            registry=registry,
        )
        self.repairs = Counter(
            "coadapt_ego_advice_repairs_total",
            "Answers that were adopted after a repair, by what was repaired.",
            ["reason"],
            registry=registry,
        )
        self.ended = Counter(
            "coadapt_ego_advice_ended_total",
            "Advice that was in force and was given up or replaced, by reason.",
            ["reason"],
            registry=registry,
        )
        self.answer_seconds = Histogram(
            "coadapt_ego_answer_seconds",
            "From a question to the answer, where one came.",
            ["source"],
            buckets=_BUCKETS,
            registry=registry,
        )
        self.tokens = Counter(
            "coadapt_ego_llm_tokens_total",
            "Tokens of answers that a model gave to this ego; reused ones are prompt tokens too.",
            ["kind"],
            registry=registry,
        )
        self.age_s = Gauge(
            "coadapt_ego_advice_age_seconds",
            "Since the advice in force was adopted; NaN without.",
            registry=registry,
        )
        self.age_s.set(math.nan)
        self.gateway = Gauge(
            "coadapt_ego_gateway_alive",
            "1 while the policy in use has an LLM gateway to ask.",
            registry=registry,
        )
        self._question = 0
        start_at_zero(self.outcomes, OUTCOMES)
        start_at_zero(self.repairs, ("unknown_robot", "infeasible", "too_many"))
        start_at_zero(self.ended, ENDED)
        start_at_zero(self.answer_seconds, ("llm", "cache"))
        start_at_zero(self.tokens, _TOKENS)

    def show(self, report: AdviceReport | None) -> None:
        """Shows how things stand in a cycle; None: the policy asks no language model."""
        age_s = report.age_s if report else None
        self.age_s.set(math.nan if age_s is None else age_s)
        self.gateway.set(report is not None and report.gateway)

    def committed(self, report: AdviceReport) -> None:
        """Counts a cycle whose journal line is on the disk."""
        self.questions.inc(max(0, report.question - self._question))
        self._question = max(self._question, report.question)
        if report.ended:
            self.ended.labels(report.ended).inc()
        answer = report.answer
        if answer is None:
            return
        self.outcomes.labels(answer.outcome).inc()
        for reason in answer.repaired:
            self.repairs.labels(reason).inc()
        if answer.source:
            self.answer_seconds.labels(answer.source).observe(answer.latency_ms * 1e-3)
        if answer.source == "llm":
            for kind in _TOKENS:
                self.tokens.labels(kind).inc(getattr(answer.tokens, kind))
