"""Questions to the LLM gateway, one at a time, without ever waiting for one."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Protocol

from ego_agent.plan.advice.outcomes import Outcome, trouble
from ego_agent.plan.prompting import LlmPrompt
from swarm import keyspace
from swarm.messages import DecideAnswer, DecideRequest
from swarm.session import Session
from swarm.traffic import TrafficClass


@dataclass(frozen=True, slots=True)
class Question:
    """A question that was sent."""

    number: int
    prompt: LlmPrompt
    asked_s: float
    """`time.monotonic()` seconds."""
    loss: int
    """How often the gateway had been lost before."""


@dataclass(frozen=True, slots=True)
class Answered:
    """What came of a question: an answer, or what kept it away."""

    question: Question
    latency_s: float
    answer: DecideAnswer | None = None
    trouble: Outcome = "no_gateway"
    """Without an answer: why there is none."""
    why: str = "the gateway went away"


class Asking(Protocol):
    """Where advice is asked for: at most one question at a time, and nobody waits."""

    @property
    def pending(self) -> bool:
        """Whether a question waits for its answer, or an answer to be taken."""
        ...

    def alive(self) -> bool:
        """Whether there is anybody to ask."""
        ...

    def ask(self, prompt: LlmPrompt) -> Question:
        """Sends a question; only while none is pending."""
        ...

    def take(self) -> Answered | None:
        """What came of the pending question, once; None while nothing has."""
        ...


class Questions:
    """At most one question is under way; its answer waits until it is taken.

    Sending and waiting happen on a thread of each question: a link that takes nothing blocks the
    sender. All methods return at once.
    """

    def __init__(self, session: Session, ego: str, deadline_s: float) -> None:
        self._session = session
        self._ego = ego
        self._deadline_s = deadline_s
        self._lock = threading.Lock()
        self._present = False
        self._losses = 0
        self._number = 0
        self._pending: Question | None = None
        self._heard: Answered | None = None
        self.close = session.watch_gateway(self._on_gateway)
        """Watches for gateways no more."""

    def alive(self) -> bool:
        """Whether there is a gateway to ask, and a link to reach it."""
        return self._present and self._session.links() > 0

    @property
    def pending(self) -> bool:
        """Whether a question waits for its answer, or an answer to be taken."""
        return self._pending is not None

    def ask(self, prompt: LlmPrompt) -> Question:
        """Sends a question; only while none is pending."""
        with self._lock:
            self._number += 1
            question = Question(self._number, prompt, time.monotonic(), self._losses)
            self._pending, self._heard = question, None
        name = f"question-{question.number}"
        threading.Thread(target=self._follow, args=(question,), name=name, daemon=True).start()
        return question

    def take(self) -> Answered | None:
        """What came of the pending question, once; None while nothing has."""
        lost = not self.alive()
        with self._lock:
            question, heard = self._pending, self._heard
            if question is None:
                return None
            if heard is None and (lost or question.loss != self._losses):
                heard = Answered(question, time.monotonic() - question.asked_s)
            if heard is not None:
                self._pending = self._heard = None
            return heard

    def _on_gateway(self, present: bool) -> None:
        """On Zenoh's thread."""
        with self._lock:
            self._losses += self._present and not present
            self._present = present

    def _follow(self, question: Question) -> None:
        heard = self._answer(question)
        with self._lock:
            if self._pending is question:
                self._heard = heard

    def _answer(self, question: Question) -> Answered:
        prompt = question.prompt
        try:
            answer = self._session.ask(
                keyspace.llm_decide(self._session.swarm),
                DecideRequest(
                    request=question.number,
                    ego=self._ego,
                    messages=prompt.messages,
                    schema=prompt.schema,
                    fingerprint=prompt.fingerprint,
                    deadline_s=self._deadline_s,
                ),
                DecideAnswer,
                timeout_s=self._deadline_s,
                traffic=TrafficClass.CONTROL,
            ).result()
        except Exception as error:  # whatever it is, the ego must be able to ask again
            waited_s = time.monotonic() - question.asked_s
            kind, why = trouble(error, waited_s, self._deadline_s)
            return Answered(question, waited_s, None, kind, why)
        return Answered(question, time.monotonic() - question.asked_s, answer.message)
