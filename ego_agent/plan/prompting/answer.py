"""A language model's answer as advice. What it advises is judged elsewhere."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NoReturn

from ego_agent.plan.choices.validation import MAX_PARTICIPANTS, shown
from ego_agent.plan.prompting.letters import ALONE, letter
from ego_agent.plan.prompting.schema import CONFIDENCE
from swarm.errors import DecisionError
from swarm.messages import ALGORITHMS, MIXED, Algorithm

if TYPE_CHECKING:
    from ego_agent.plan.prompting.prompt import LlmPrompt

MAX_TEXT = 100_000
MAX_REASON = 500


@dataclass(frozen=True, slots=True)
class Advice:
    """What a language model advises."""

    participants: tuple[str, ...]
    """The ego first, everyone once; also robots that are not there."""
    algorithm: str
    """MIXED where robots are to send different things."""
    reason: str
    confidence: float
    """In [0, 1], for what the model says in a word; 1 where it is not asked."""
    forms: Mapping[str, Algorithm] = field(default_factory=dict)
    """By which algorithm each robot sends, where that differs."""


def read_answer(text: str, prompt: LlmPrompt) -> Advice:
    """The advice in an answer to a prompt.

    Raises DecisionError that names what is wrong with its form. Robots and algorithms that cannot
    be used are no fault of form.
    """
    if len(text) > MAX_TEXT:
        raise DecisionError(f"the answer has {len(text)} characters, at most {MAX_TEXT} are read")
    try:
        answer = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise DecisionError(f"the answer is no JSON: {error}") from error
    if prompt.letters:
        return _in_letters(answer, prompt)
    if not isinstance(answer, dict):
        raise DecisionError(f"the answer is {shown(answer)}, not an object")
    helpers = _field(answer, "helpers")
    if not isinstance(helpers, list) or not all(isinstance(robot, str) for robot in helpers):
        raise DecisionError("the answer's helpers are not a list of robot ids")
    if len(helpers) > MAX_PARTICIPANTS:
        raise DecisionError(
            f"the answer names {len(helpers)} helpers, at most {MAX_PARTICIPANTS} are read"
        )
    algorithm, reason = _text(answer, "algorithm"), _text(answer, "explanation")
    participants = tuple(dict.fromkeys((prompt.ego, *helpers)))
    return Advice(participants, algorithm, reason[:MAX_REASON], _confidence(answer))


def _in_letters(answer: object, prompt: LlmPrompt) -> Advice:
    """Algorithms, each with the letters behind it, or one word for the ego alone; its reason is
    code's to tell."""
    if not isinstance(answer, str):
        raise DecisionError(f"the answer is {shown(answer)}, not text")
    if answer == ALONE:
        return Advice((prompt.ego,), prompt.alone, "", 1.0)
    robots = {letter(at): robot for at, robot in enumerate(prompt.candidates)}
    name, *words = answer.split(" ")
    algorithm = next((one for one in ALGORITHMS if one == name), None)
    forms: dict[str, Algorithm] = {}
    for word in words:
        if word in robots:
            if algorithm is not None:
                forms.setdefault(robots[word], algorithm)
        elif word in ALGORITHMS:
            algorithm = next(one for one in ALGORITHMS if one == word)
        else:
            allowed = " ".join(robots) or "none"
            raise DecisionError(f"the answer names {shown(word)}; allowed: {allowed}")
    kinds = {*forms.values()}
    if algorithm is None:
        named = [robots[word] for word in words if word in robots]
        return Advice(tuple(dict.fromkeys((prompt.ego, *named))), name, "", 1.0)
    if len(kinds) <= 1:
        return Advice((prompt.ego, *forms), next(iter(kinds), algorithm), "", 1.0)
    return Advice((prompt.ego, *forms), MIXED, "", 1.0, forms)


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no JSON number")


def _field(answer: dict[str, Any], name: str) -> Any:
    if name not in answer:
        raise DecisionError(f"the answer has no {name}")
    return answer[name]


def _text(answer: dict[str, Any], name: str) -> str:
    value = _field(answer, name)
    if not isinstance(value, str):
        raise DecisionError(f"the answer's {name} is {shown(value)}, not text")
    return value


def _confidence(answer: dict[str, Any]) -> float:
    """Also of a number from 0 to 100, which models without a grammar like to give."""
    value = _field(answer, "confidence")
    if isinstance(value, str) and value in CONFIDENCE:
        return CONFIDENCE[value]
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 100:
        return value / 100.0
    what = value if isinstance(value, int | float) else shown(value)
    allowed = ", ".join(CONFIDENCE)
    raise DecisionError(f"the answer's confidence is {what}; allowed: {allowed}, or 0 to 100")
