"""The JSON schema of one answer: it holds the hard rules of one scene.

Only robots that are candidates can be named, only algorithms with which the link carries at least
one of them, and no more robots than it can carry of the smallest observations. The ego takes part
whatever the answer is, so it is not asked for.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from ego_agent.prompting.table import usable
from ego_agent.scoring import Scorer
from swarm.messages import Algorithm

MAX_REASON = 80
"""Characters: a sentence of about 20 tokens, half a second on two cores."""


@dataclass(frozen=True, slots=True)
class Choice:
    """Who may take part with an algorithm, and how many of them at most."""

    algorithm: Algorithm
    robots: tuple[str, ...]
    at_most: int


def choices(scorer: Scorer, robots: Sequence[str]) -> tuple[Choice, ...]:
    """By algorithm; without those with which the link carries nobody."""
    found = []
    for algorithm in scorer.knowledge.algorithms:
        able = tuple(robot for robot in robots if usable(scorer, robot, algorithm))
        sizes = accumulate(sorted(scorer.size(robot, algorithm) for robot in able))
        if able:
            number = sum(total <= scorer.budget_bytes for total in sizes)
            found.append(Choice(algorithm, able, number))
    return tuple(found)


def answer_schema(found: Sequence[Choice], alone: Algorithm) -> str:
    """Draft 2020-12, as compact text that is the same for the same choices.

    The decision comes first and in one place, so that the words of its reason cannot change it.
    `alone` is what the ego uses where nobody can take part.
    """
    rules: dict[tuple[tuple[str, ...], int], list[Algorithm]] = {}
    for choice in found:
        rules.setdefault((choice.robots, choice.at_most), []).append(choice.algorithm)
    options = [
        _answer(
            names,
            {
                "type": "array",
                "items": {"type": "string", "enum": list(robots)},
                "maxItems": at_most,
                "uniqueItems": True,
            },
        )
        for (robots, at_most), names in rules.items()
    ] or [_answer([alone], {"const": []})]
    schema = options[0] if len(options) == 1 else {"anyOf": options}
    return json.dumps(schema, separators=(",", ":"))


def _answer(algorithms: Sequence[str], helpers: dict[str, Any]) -> dict[str, Any]:
    properties = {
        "algorithm": {"type": "string", "enum": list(algorithms)},
        "helpers": helpers,
        "confidence": {"type": "integer", "minimum": 0, "maximum": 100},
        "reason": {"type": "string", "maxLength": MAX_REASON},
    }
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
