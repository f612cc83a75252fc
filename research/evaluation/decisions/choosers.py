"""Those who are compared: each sees a scene in short and names who helps, and how."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

from ego_agent.knowledge.model import Proposal
from ego_agent.plan.choices.hysteresis import best_option
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.policies.base import Policy
from ego_agent.plan.prompting import LlmPrompt, read_answer
from ego_agent.plan.prompting.short import ShortScene, make_short_prompt
from llm_gateway.answers import AnswerError, extract
from llm_gateway.model import Prompt
from llm_gateway.schemas import Schemas
from research.evaluation.policies.advice import Answer
from swarm.errors import DecisionError
from swarm.messages import Algorithm

FIRST = 2
"""Helpers of `first k`: as many as `coverage` takes most often."""


@dataclass(frozen=True, slots=True)
class Case:
    """One scene at one rate."""

    scorer: Scorer
    short: ShortScene
    group: int
    """Of the scene, whatever its rate."""


@dataclass(frozen=True, slots=True)
class Said:
    """A choice; None where what was said cannot be read."""

    participants: tuple[str, ...] | None
    """Without the ego."""
    algorithm: str
    took_s: float = 0.0


class Chooser(Protocol):
    """Somebody who decides."""

    @property
    def name(self) -> str:
        """In the table."""
        ...

    def choose(self, case: Case) -> Said:
        """Who helps."""
        ...


@dataclass(frozen=True)
class ByOption:
    """Takes one of the answers that the prompt allows."""

    name: str
    pick: Callable[[ShortScene], tuple[Algorithm, int]]

    def choose(self, case: Case) -> Said:
        """See Chooser."""
        begun = time.perf_counter()
        algorithm, helpers = self.pick(case.short)
        return Said(case.short.robots[:helpers], algorithm, time.perf_counter() - begun)


@dataclass(frozen=True)
class ByPolicy:
    """Decides as a policy of the ego."""

    name: str
    policy: Policy

    def choose(self, case: Case) -> Said:
        """See Chooser."""
        begun = time.perf_counter()
        scorer = case.scorer
        found: Proposal = self.policy.propose(scorer.scene, scorer.knowledge, None)
        others = tuple(r for r in found.participants if r != scorer.scene.ego.robot)
        return Said(others, found.algorithm, time.perf_counter() - begun)


class Oracle:
    """The best of all sets, algorithms and paces, by the objective."""

    name = "oracle"

    def choose(self, case: Case) -> Said:
        """See Chooser."""
        begun = time.perf_counter()
        best = best_option(case.scorer, list(_every(case.scorer)))
        return Said(best.participants, best.algorithm, time.perf_counter() - begun)


def _every(scorer: Scorer) -> list[Score]:
    found = [scorer.score((), scorer.knowledge.best_algorithm())]
    robots = [candidate.robot for candidate in scorer.scene.candidates]
    for at in map(scorer.at, scorer.paces):
        for name in scorer.knowledge.algorithms:
            able = [robot for robot in robots if at.can(robot, name)]
            sets = (s for k in range(1, len(able) + 1) for s in combinations(able, k))
            found += [score for score in (at.score(s, name) for s in sets) if at.fits(score)]
    return found


class Asked(Protocol):
    """A language model, as `research.evaluation.policies.advice.Model`."""

    name: str

    def ask(self, prompt: Prompt) -> Answer:
        """Its answer."""
        ...


class ByModel:
    """Asks a language model with the short prompt, its answer bound by the schema, or free."""

    def __init__(self, model: Asked, name: str = "", *, bound: bool = True) -> None:
        self.name = (name or model.name) + ("" if bound else " (free)")
        self._model, self._bound = model, bound
        self._schemas = Schemas()

    def choose(self, case: Case) -> Said:
        """See Chooser."""
        scorer = case.scorer
        prompt = make_short_prompt(scorer.scene, scorer.knowledge, None, None, scorer=scorer)
        schema = prompt.schema if self._bound else ""
        answer = self._model.ask(Prompt(prompt.messages, schema, max_tokens=32))
        try:
            read = read_answer(self._words(answer.text, prompt), prompt)
        except (AnswerError, DecisionError):
            return Said(None, "", answer.took_s)
        return Said(read.participants[1:], read.algorithm, answer.took_s)

    def _words(self, text: str, prompt: LlmPrompt) -> str:
        return extract(text, prompt.schema, self._schemas)


def at_random(seed: int) -> ByOption:
    """Any answer that is allowed, all equally likely."""
    rng = random.Random(seed)
    return ByOption("random", lambda short: rng.choice(short.options))


def first_k(short: ShortScene) -> tuple[Algorithm, int]:
    """The first FIRST, or as many as there are, by the first algorithm of the list that is allowed
    for them."""
    fewest = min(short.options, key=lambda option: abs(option[1] - FIRST))[1]
    return next(option for option in short.options if option[1] == fewest)


def by_rule(short: ShortScene) -> tuple[Algorithm, int]:
    """By each algorithm those fit at the fastest rate whose `adds` is worth its price, from the
    first on; of that the option that leaves most when the prices are paid."""

    def left(option: tuple[Algorithm, int]) -> tuple[bool, float]:
        name, helpers = option
        worth = sum(one - short.price[name] for one in short.adds[:helpers])
        return helpers <= short.fits[name][0], worth

    return max(short.options, key=left)


def as_json(said: Said) -> str:
    """For samples."""
    return json.dumps([said.algorithm, said.participants])
