"""Those who are compared: each sees a scene in short and names who helps, and how."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

from ego_agent.knowledge.model import Proposal
from ego_agent.plan.choices.hysteresis import best_option
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.policies.base import Policy
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting import LlmPrompt, read_answer
from ego_agent.plan.prompting.letters import Groups, helpers
from ego_agent.plan.prompting.short import ShortScene, forms, make_short_prompt
from llm_gateway.answers import AnswerError, extract
from llm_gateway.model import Prompt
from llm_gateway.schemas import Schemas
from research.evaluation.policies.advice import Answer
from swarm.errors import DecisionError
from swarm.messages import Assignment

FIRST = 3
"""Helpers of `first k`: as many as `coverage` takes most often."""
CHANGES = 40
"""Of one robot's assignment, until the search for the best choice ends."""


@dataclass(frozen=True, slots=True)
class Case:
    """One scene at one rate."""

    scorer: Scorer
    short: ShortScene
    options: tuple[Groups, ...]
    """What the short prompt allows."""
    group: int
    """Of the scene, whatever its rate."""


@dataclass(frozen=True, slots=True)
class Said:
    """A choice; None where what was said cannot be read."""

    sends: Mapping[str, str] | None
    """By which algorithm each helper sends."""
    took_s: float = 0.0
    tokens: tuple[int, int] | None = None
    """Of a language model's prompt and answer, where they are known."""


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
    pick: Callable[[ShortScene, Sequence[Groups]], Groups]

    def choose(self, case: Case) -> Said:
        """See Chooser."""
        begun = time.perf_counter()
        groups = self.pick(case.short, case.options)
        return Said(forms(case.short.robots, groups), time.perf_counter() - begun)


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
        sends: dict[str, str] = dict.fromkeys(found.participants[1:], found.algorithm)
        sends |= {one.robot: one.algorithm for one in found.assignments}
        return Said(sends, time.perf_counter() - begun)


class Oracle:
    """The best that is found from `coverage`'s choice, and from the best set of one algorithm, by
    changing what one robot sends, and how often, as long as that brings anything."""

    name = "oracle"

    def choose(self, case: Case) -> Said:
        """See Chooser."""
        begun = time.perf_counter()
        scorer = case.scorer
        mixes = Mixes(scorer)
        coverage, _ = Coverage().choose(scorer, None)
        same = best_option(scorer, list(_every(scorer)))
        found = [coverage, same]
        for start in (coverage, mixes.rated_as(same.sends)):
            found.append(_climbed(mixes, start))
        return Said(best_option(scorer, found).sends, time.perf_counter() - begun)


def _climbed(mixes: Mixes, start: Score) -> Score:
    """The choice after the best change of one robot's assignment, and the next, and so on."""
    scorer, best = mixes.scorer, start
    if start.pace != scorer.pace:
        return start
    for _ in range(CHANGES):
        now = {one.robot: one for one in best.assignments} or {
            robot: Assignment(robot=robot, algorithm=name, rate_hz=scorer.pace.rate_hz)
            for robot, name in best.sends.items()
        }
        tried = [best]
        for candidate in scorer.scene.candidates:
            robot = candidate.robot
            for option in (None, *mixes.options_of(robot)):
                others = [one for one in now.values() if one.robot != robot]
                score = mixes.score([*others, option] if option else others)
                if score is not None and (not score.participants or mixes.carries(score)):
                    tried.append(score)
        found = best_option(scorer, tried)
        if found is best:
            break
        best = found
    return best


def _every(scorer: Scorer) -> list[Score]:
    found = [scorer.score((), scorer.knowledge.best_algorithm())]
    robots = [candidate.robot for candidate in scorer.scene.candidates]
    for at in map(scorer.at, scorer.paces):
        for name in scorer.knowledge.algorithms:
            able = [robot for robot in robots if at.can(robot, name)]
            sets = (s for k in range(1, len(able) + 1) for s in combinations(able, k))
            found += [score for score in (at.score(s, name) for s in sets) if at.fits(score)]
    return found


class AskableModel(Protocol):
    """A language model, as `research.evaluation.policies.advice.Model`."""

    name: str

    def ask(self, prompt: Prompt) -> Answer:
        """Its answer."""
        ...


class ByModel:
    """Asks a language model with the short prompt, its answer bound by the schema, or free."""

    def __init__(self, model: AskableModel, name: str = "", *, bound: bool = True) -> None:
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
            return Said(None, answer.took_s, answer.tokens)
        sends: dict[str, str] = dict.fromkeys(read.participants[1:], read.algorithm)
        return Said(sends | {**read.forms}, answer.took_s, answer.tokens)

    def _words(self, text: str, prompt: LlmPrompt) -> str:
        return extract(text, prompt.schema, self._schemas)


def at_random(seed: int) -> ByOption:
    """Any answer that is allowed, all equally likely."""
    rng = random.Random(seed)
    return ByOption("random", lambda short, options: rng.choice(options))


def first_k(short: ShortScene, options: Sequence[Groups]) -> Groups:
    """The first FIRST, or as many as there are, by the first algorithm of the list that is allowed
    for them."""
    return min(options, key=lambda groups: (abs(helpers(groups) - FIRST), len(groups)))


def by_rule(short: ShortScene, options: Sequence[Groups]) -> Groups:
    """The option that leaves most of what its helpers add when their prices are paid."""

    def left(groups: Groups) -> float:
        prices = [short.price[name] for name, count in groups for _ in range(count)]
        return sum(adds - price for adds, price in zip(short.adds, prices, strict=False))

    return max(options, key=left)


def as_json(said: Said) -> str:
    """For samples."""
    return json.dumps(said.sends)
