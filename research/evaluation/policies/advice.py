"""A language model's advice in an experiment: the ego's own policy, waiting for answers."""

from __future__ import annotations

import asyncio
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.plan.advice.questions import Answered, Question
from ego_agent.plan.policies.llm import Llm
from ego_agent.plan.prompting import LlmPrompt
from ego_agent.settings import EgoSettings, PromptStyle
from llm_gateway.answers import AnswerError, extract
from llm_gateway.backends.base import Backend
from llm_gateway.backends.llamacpp.client import LlamaCpp
from llm_gateway.backends.llamacpp.models import find_model
from llm_gateway.backends.registry import make_backend
from llm_gateway.model import Prompt
from llm_gateway.schemas import Schemas
from llm_gateway.settings import load_settings
from research.evaluation.result_store import ResultStore
from research.evaluation.windows.links import WINDOW_S
from swarm.errors import EvaluationError, GatewayError
from swarm.log import make_logger
from swarm.messages import DecideAnswer, Decision

TIMEOUT_S = 120.0
MADE_FROM = ("llm_gateway/backends",)
"""What decides an answer, apart from the model and the prompt, which are its key."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A model's words, or why there are none, and how long that took."""

    text: str
    trouble: str
    took_s: float
    tokens: tuple[int, int] | None = None
    """Of the prompt and of the answer, where they are known."""


class Model:
    """A language model behind a back end of the gateway; what it has answered is asked no more."""

    def __init__(self, spec: str, kept: ResultStore, adapter: Path | None = None) -> None:
        """`spec`: a model that a package carries, a path of a GGUF file, or NAME@URL of an
        OpenAI-compatible server (key: COADAPT_LLM_API_KEY). Raises SettingError for what cannot
        work, EvaluationError for a specification without a name. `adapter`: what was learned beside
        the weights of a model of this machine, as a GGUF file."""
        name, at, url = spec.partition("@")
        if not name:
            raise EvaluationError(f"model {spec!r} has no name; allowed: NAME, FILE or NAME@URL")
        settings = msgspec.structs.replace(
            load_settings(os.environ),
            llm_backend="openai" if at else "llamacpp",
            llm_url=url,
            llm_model=name,
            llm_parallel=1,
        )
        log = make_logger("eval", level="warning")
        self._backend: Backend = make_backend(settings, log)
        self._identity = spec if at else _identity(find_model(name))
        self.name = self._backend.model or name
        if adapter is not None:
            if at:
                raise EvaluationError(f"model {spec!r} is a server: it takes no adapter")
            if not adapter.is_file():
                raise EvaluationError(f"adapter {str(adapter)!r} is no file")
            path, context = find_model(name), settings.llm_context
            self._backend = LlamaCpp(path, 1, context, settings.llm_threads, log, adapter=adapter)
            self._identity += f" {_identity(adapter)}"
            self.name += f" + {adapter.stem}"
        self._kept = kept
        self._runner: asyncio.Runner | None = None

    def start(self) -> None:
        """Loads the model. Raises SettingError where that is not possible."""
        if self._runner is None:
            runner = asyncio.Runner()
            try:
                runner.run(self._backend.start())
            except BaseException:
                runner.close()
                raise
            self._runner = runner

    def ask(self, prompt: Prompt) -> Answer:
        """The model's answer. One that did not come is asked for again the next time."""
        key = prompt.key(self._identity)
        values = self._kept.get(key)
        if values is not None:
            text, trouble, took_s, *tokens = values
            return Answer(text, trouble, took_s, (tokens[0], tokens[1]) if tokens else None)
        answer = self._ask(prompt)
        if not answer.trouble:
            values = [answer.text, answer.trouble, answer.took_s, *(answer.tokens or ())]
            self._kept.put(key, values)
        return answer

    def close(self) -> None:
        """Ends the model."""
        if self._runner is not None:
            self._runner.run(self._backend.close())
            self._runner.close()
            self._runner = None

    def _ask(self, prompt: Prompt) -> Answer:
        self.start()
        assert self._runner is not None
        begun = time.monotonic()
        try:
            reply = self._runner.run(self._backend.complete(prompt, TIMEOUT_S))
            told = reply.tokens
            tokens = (told.prompt, told.output) if told.prompt else None
            return Answer(reply.text, "", time.monotonic() - begun, tokens)
        except GatewayError as error:
            return Answer("", str(error), time.monotonic() - begun)


def _identity(path: Path) -> str:
    about = path.stat()
    return f"{path} {about.st_size} {about.st_mtime_ns}"


class Adviser(Protocol):
    """Whoever answers questions in an experiment, such as a `Model`."""

    @property
    def name(self) -> str:
        """How it is called."""
        ...

    def ask(self, prompt: Prompt) -> Answer:
        """Its answer, as soon as that is there."""
        ...


class AtOnce:
    """Questions that are answered before `ask` returns. Implements `Asking`."""

    def __init__(self, model: Adviser) -> None:
        self._model = model
        self._schemas = Schemas()
        self._number = 0
        self._heard: Answered | None = None
        self.now_s = 0.0
        """The experiment's clock."""
        self.waited_s = 0.0
        """For all answers so far, as long as they took when they were made."""
        self.answered = True
        """Whether the newest question had an answer."""

    @property
    def pending(self) -> bool:
        """See `Asking`."""
        return self._heard is not None

    def alive(self) -> bool:
        """See `Asking`."""
        return True

    def ask(self, prompt: LlmPrompt) -> Question:
        """See `Asking`."""
        self._number += 1
        question = Question(self._number, prompt, self.now_s, 0)
        answer = self._model.ask(Prompt(prompt.messages, prompt.schema))
        self.waited_s += answer.took_s
        self.answered = not answer.trouble
        self._heard = self._hear(question, answer)
        return question

    def take(self) -> Answered | None:
        """See `Asking`."""
        heard, self._heard = self._heard, None
        return heard

    def _hear(self, question: Question, answer: Answer) -> Answered:
        if answer.trouble:
            return Answered(question, answer.took_s, None, "failed", answer.trouble)
        try:
            decision = extract(answer.text, question.prompt.schema, self._schemas)
        except AnswerError as error:
            return Answered(question, answer.took_s, None, "invalid", str(error))
        return Answered(
            question,
            answer.took_s,
            DecideAnswer(
                request=question.number, decision=decision, source="llm", model=self._model.name
            ),
        )


class AdvisedAtOnce:
    """The ego's `llm` policy, which in each window hears what it has asked for.

    Each proposal is for the next control window: the policy's clock knows no other time, so that
    slow and kept answers lead to the same decisions.
    """

    def __init__(self, model: Adviser, prompt: PromptStyle = "table") -> None:
        """`prompt`: how the model is asked."""
        self.name = f"llm-{model.name}" + (f"-{prompt}" if prompt != "table" else "")
        self._questions = AtOnce(model)
        self._policy = Llm(self._questions, lambda: self._questions.now_s)
        self._policy.prepare(EgoSettings(llm_prompt=prompt))

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """What the ego would propose as soon as the answer is there."""
        self._questions.now_s += WINDOW_S
        proposal = self._policy.propose(scene, knowledge, previous)
        if self._questions.pending:
            proposal = self._policy.propose(scene, knowledge, previous)
        return proposal

    @property
    def waited_s(self) -> float:
        """For the model's answers so far."""
        return self._questions.waited_s

    @property
    def answered(self) -> bool:
        """Whether the newest question had an answer, of whatever use; true before any."""
        return self._questions.answered
