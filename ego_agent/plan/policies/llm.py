"""A language model's advice, ahead of need and never waited for; `coverage` where there is none.

Every cycle takes what has come, judges it in the scene as it is now, and proposes at once: fresh
advice (source `llm` or `cache`), advice that still holds (`hold`), or what `coverage` would do
(`fallback`). docs/llm.md has the rules.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.plan.advice.adopted import Advice, Cycle, answer_report
from ego_agent.plan.advice.judge import Advised, Verdict, judge
from ego_agent.plan.advice.outcomes import Refused, plain
from ego_agent.plan.advice.questions import Answered, Asking, Question, Questions
from ego_agent.plan.assign import steady
from ego_agent.plan.choices.hysteresis import held
from ego_agent.plan.choices.options import compare
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.validation import make_decision
from ego_agent.plan.policies.coverage import Coverage, reason_of
from ego_agent.plan.prompting import prompt_maker, read_answer
from ego_agent.plan.prompting.fingerprint import scene_fingerprint
from ego_agent.plan.surrogate.model import Surrogate, packaged_surrogate
from ego_agent.settings import EgoSettings
from swarm.errors import DecisionError
from swarm.messages import MIXED, AdviceReport, AdviceState, Decision
from swarm.session import Session

NO_GATEWAY = "no language model was asked: no LLM gateway is connected"


class Llm:
    """Asks the LLM gateway of its swarm; without one it decides as `coverage` does."""

    name = "llm"

    def __init__(
        self,
        questions: Asking | None = None,
        clock: Callable[[], float] = time.monotonic,
        surrogate: Surrogate | None = None,
    ) -> None:
        """`questions`: whom to ask until `connect` says otherwise. `clock`: seconds; questions must
        be stamped with the same one. `surrogate`: who predicts what advice would bring; where
        None, what `coverage` predicts counts."""
        self._clock = clock
        self._surrogate = surrogate
        self._settings = EgoSettings()
        self._make_prompt = prompt_maker(self._settings.llm_prompt)
        self._questions = questions
        self._coverage = Coverage()
        self._shadow: Decision | None = None
        """What `coverage` would have in force by now, had it decided all along."""
        self._held: Advice | None = None
        self._last: Question | None = None
        """The newest question."""
        self._asked_for = ""
        """The fingerprint last asked for; empty: a question is due whatever the scene."""
        self._refusal = ""
        """Why the last advice was refused or given up."""
        self._refused_for = ""
        """The fingerprint of the scene in which it was."""

    def prepare(self, settings: EgoSettings) -> None:
        """Takes up how to ask, and who predicts what advice would bring. Raises DecisionError when
        that is a surrogate that cannot be read."""
        self._make_prompt = prompt_maker(settings.llm_prompt)
        if settings.llm_judge == "surrogate":
            self._surrogate = packaged_surrogate()

    def connect(self, session: Session, settings: EgoSettings) -> None:
        """From now on asks the gateway of the session's swarm, whenever one is alive."""
        self._settings = settings
        self._questions = Questions(session, settings.ego, settings.llm_deadline_s)

    def close(self) -> None:
        """Asks no more; what is under way is forgotten."""
        questions, self._questions = self._questions, None
        if isinstance(questions, Questions):
            questions.close()

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """Advice that is better than the fallback or nearly as good, else the fallback."""
        questions = self._questions
        cycle = self._begin(Scorer(scene, knowledge), questions)
        heard = questions.take() if questions is not None else None
        if questions is None or not cycle.gateway:
            self._lose(cycle, heard)
            return self._proposal(cycle)
        cycle.fingerprint = scene_fingerprint(cycle.scorer)
        if heard is not None:
            self._hear(cycle, heard)
        if self._held is not None and cycle.fresh is None:
            self._check(cycle, self._held)
        if self._due(cycle) and not questions.pending:
            self._ask(cycle, questions, previous)
        if cycle.advised is not None and cycle.advised.algorithm == MIXED and cycle.compared.mixes:
            cycle.advised = steady(cycle.compared.mixes, cycle.advised, previous)
        return self._proposal(cycle)

    def _begin(self, scorer: Scorer, questions: Asking | None) -> Cycle:
        """The fallback is what `coverage` would decide, had it decided so far: advice that it would
        not have chosen must not become what it holds on to."""
        compared = compare(scorer)
        score, reason = self._coverage.choose_among(compared, self._shadow)
        now_ns = round(self._clock() * 1e9)
        shadow = make_decision(
            scorer,
            score,
            reason=reason,
            source="fallback",
            repairs=(),
            policy=self.name,
            cycle=0,
            now_ns=now_ns,
        )
        self._shadow = held(shadow, self._shadow, now_ns)
        alive = questions is not None and questions.alive()
        return Cycle(compared, score, reason, self._clock(), alive)

    def _lose(self, cycle: Cycle, heard: Answered | None) -> None:
        """There is no gateway: nothing is held, and it is asked at once when it is back."""
        if heard is not None:
            cycle.answer = answer_report(heard, "no_gateway", heard.why)
        if self._held is not None:
            self._held, cycle.ended = None, "no_gateway"
        self._asked_for = ""

    def _due(self, cycle: Cycle) -> bool:
        """Whether the scene is another than the one last asked for, or the period is over."""
        last = self._last
        return (
            last is None
            or cycle.fingerprint != self._asked_for
            or cycle.now_s - last.asked_s >= self._settings.llm_period_s
        )

    def _ask(self, cycle: Cycle, questions: Asking, previous: Decision | None) -> None:
        scorer = cycle.scorer
        results = scorer.knowledge.results()
        prompt = self._make_prompt(
            scorer.scene,
            scorer.knowledge,
            previous,
            results[-1] if results else None,
            scorer=scorer,
        )
        self._last, self._asked_for = questions.ask(prompt), cycle.fingerprint
        cycle.asked = True

    def _hear(self, cycle: Cycle, heard: Answered) -> None:
        """Adopts or refuses what came of a question."""
        if heard.answer is None:
            if heard.trouble == "no_gateway":
                self._asked_for = ""  # a new gateway's queryable may be a moment behind its token
            cycle.answer = answer_report(heard, heard.trouble, heard.why)
            self._refuse(cycle, heard.why)
            return
        try:
            advice = read_answer(heard.answer.decision, heard.question.prompt)
        except DecisionError as error:
            self._not_followed(cycle, heard, "unreadable", plain(str(error)))
            return
        least = self._settings.llm_min_confidence
        if advice.confidence < least:
            why = f"its confidence is {advice.confidence:.2f}, allowed: >= {least:.2f}"
            verdict = Verdict("low_confidence", why)
        else:
            what = Advised(advice.participants, advice.algorithm, advice.forms)
            verdict = self._judge(cycle, what)
        if verdict.refused is not None:
            self._not_followed(cycle, heard, verdict.refused, verdict.why)
            return
        cycle.answer = answer_report(heard, "adopted", "", verdict.repaired)
        if self._held is not None:
            cycle.ended = "replaced"
        cycle.fresh, cycle.notes = heard.answer.source, verdict.notes
        cycle.advised = verdict.score
        self._held = Advice(
            Advised(verdict.participants, verdict.algorithm, verdict.forms),
            plain(advice.reason),
            cycle.answer.model,
            cycle.now_s,
        )
        self._refusal = self._refused_for = ""

    def _not_followed(self, cycle: Cycle, heard: Answered, outcome: Refused, why: str) -> None:
        cycle.answer = answer_report(heard, outcome, f"refused: {why}")
        self._refuse(cycle, cycle.answer.why)

    def _check(self, cycle: Cycle, held: Advice) -> None:
        """Gives up advice that does not hold any more, as it is, in the scene as it is now."""
        verdict = self._judge(cycle, held.what)
        limit_s = self._settings.llm_hold_max_s
        if cycle.now_s - held.since_s > limit_s:
            cycle.ended, why = "too_old", f"it is older than {limit_s:g} s"
        elif verdict.refused is not None:
            cycle.ended, why = verdict.refused, verdict.why
        elif verdict.repaired:
            cycle.ended, why = verdict.repaired[0], "; ".join(verdict.notes)
        else:
            cycle.advised = verdict.score
            return
        self._held = None
        self._refuse(cycle, f"given up: {why}")

    def _judge(self, cycle: Cycle, what: Advised) -> Verdict:
        margin = self._settings.llm_value_margin
        return judge(what, cycle.scorer, cycle.fallback, margin=margin, surrogate=self._surrogate)

    def _refuse(self, cycle: Cycle, why: str) -> None:
        self._refusal, self._refused_for = why, cycle.fingerprint

    def _proposal(self, cycle: Cycle) -> Proposal:
        held, report = self._held, self._report(cycle)
        if held is not None:
            mixed = cycle.advised if held.what.forms else None
            return Proposal(
                tuple(held.what.participants),
                held.what.algorithm,
                _reason(cycle, held),
                cycle.fresh or "hold",
                model=held.model,
                notes=cycle.notes,
                advice=report,
                rate_hz=mixed.pace.rate_hz if mixed else None,
                assignments=mixed.assignments if mixed else (),
                compared=cycle.compared,
            )
        note = NO_GATEWAY if not cycle.gateway else ""
        if cycle.gateway and self._refused_for == cycle.fingerprint:
            note = self._refusal
        return Proposal(
            (cycle.scorer.scene.ego.robot, *cycle.fallback.participants),
            cycle.fallback.algorithm,
            cycle.fallback_reason,
            "fallback",
            notes=(note,) if note else (),
            advice=report,
            rate_hz=cycle.fallback.pace.rate_hz,
            assignments=cycle.fallback.assignments,
            compared=cycle.compared,
        )

    def _report(self, cycle: Cycle) -> AdviceReport:
        held, last = self._held, self._last
        return AdviceReport(
            state=self._state(cycle),
            gateway=cycle.gateway,
            question=last.number if last else 0,
            asked_s=round(max(0.0, cycle.now_s - last.asked_s), 3) if last else None,
            fingerprint=cycle.fingerprint,
            model=held.model if held else "",
            age_s=round(cycle.now_s - held.since_s, 3) if held else None,
            ended=cycle.ended or "",
            refusal=self._refusal,
            answer=cycle.answer,
        )

    def _state(self, cycle: Cycle) -> AdviceState:
        if self._held is not None:
            return "adopted" if cycle.fresh else "held"
        if not cycle.gateway:
            return "none"
        if cycle.answer is not None:
            return "refused"
        if cycle.asked:
            return "asked"
        if self._questions is not None and self._questions.pending:
            return "waiting"
        return "refused" if self._refusal else "none"


def _reason(cycle: Cycle, held: Advice) -> str:
    """What is known of the advice, and only then what the model says: its words are no facts."""
    words = f'{held.model} says: "{held.reason}"' if held.reason else ""
    if cycle.advised is None:
        return words
    advised = cycle.advised
    if not held.what.forms:
        # Rates of one algorithm are assigned, and told, when the decision is made.
        advised = dataclasses.replace(advised, assignments=())
    facts = reason_of(cycle.scorer, advised, kept=False)
    return f"{facts} {words}".rstrip()


POLICIES = (Llm,)
