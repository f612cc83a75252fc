"""The JSON schema of one answer: it holds the hard rules of one scene.

Only robots that are candidates can be named, only algorithms with which the link carries at least
one of them, no more robots than it can carry of the smallest observations, and no fewer than Q_min
needs. The ego takes part whatever the answer is, so it is not asked for.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.prompting.table import usable
from swarm.messages import Algorithm

MAX_REASON = 80
"""Characters: a sentence of about 20 tokens, half a second on two cores."""
CONFIDENCE = {"low": 0.2, "medium": 0.5, "high": 0.8}
"""What each word counts for. Small models that are asked for a number say 0."""
ROUNDING = 1e-9
"""Less is a rounding error, not quality."""


@dataclass(frozen=True, slots=True)
class Choice:
    """Who may take part with an algorithm, and how many of them."""

    algorithm: Algorithm
    robots: tuple[str, ...]
    at_least: int
    at_most: int


def choices(scorer: Scorer, robots: Sequence[str]) -> tuple[Choice, ...]:
    """By algorithm; without those with which the link carries nobody."""
    found = []
    for algorithm in scorer.knowledge.algorithms:
        able = tuple(robot for robot in robots if usable(scorer, robot, algorithm))
        sizes = accumulate(sorted(scorer.size(robot, algorithm) for robot in able))
        if able:
            most = sum(total <= scorer.budget_bytes for total in sizes)
            least = min(_needed(scorer, able, algorithm), most)
            found.append(Choice(algorithm, able, least, most))
    return tuple(found)


def _needed(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> int:
    """Helpers without which Q_min cannot be reached; 1 where it cannot be reached at all, because
    then the best quality counts, and each of them adds to it.

    Together robots add no more than the sum of what each adds to the ego alone.
    """
    own = scorer.share([0])
    if scorer.good_enough(scorer.score((), scorer.knowledge.best_algorithm())):
        return 0
    gains = [scorer.share([0, scorer.row_of[robot]]) - own for robot in robots]
    most = accumulate(sorted(gains, reverse=True), initial=own)
    enough = scorer.objective.q_min - ROUNDING
    quality = [scorer.quality(algorithm, share, 0) for share in most]
    return max(1, next((k for k, q in enumerate(quality) if q >= enough), 1))


def answer_schema(found: Sequence[Choice], alone: Algorithm) -> str:
    """Draft 2020-12, as compact text that is the same for the same choices.

    The decision comes first and in one place, so that the words of its reason cannot change it.
    `alone` is what the ego uses where nobody can take part.
    """
    rules: dict[tuple[tuple[str, ...], int, int], list[Algorithm]] = {}
    for choice in found:
        rule = (choice.robots, choice.at_least, choice.at_most)
        rules.setdefault(rule, []).append(choice.algorithm)
    options = [
        _answer(
            names,
            {
                "type": "array",
                "items": {"type": "string", "enum": list(robots)},
                "minItems": at_least,
                "maxItems": at_most,
                "uniqueItems": True,
            },
        )
        for (robots, at_least, at_most), names in rules.items()
    ] or [_answer([alone], {"const": []})]
    schema = options[0] if len(options) == 1 else {"anyOf": options}
    return json.dumps(schema, separators=(",", ":"))


def _answer(algorithms: Sequence[str], helpers: dict[str, Any]) -> dict[str, Any]:
    properties = {
        "algorithm": {"type": "string", "enum": list(algorithms)},
        "helpers": helpers,
        "confidence": {"type": "string", "enum": list(CONFIDENCE)},
        "explanation": {"type": "string", "maxLength": MAX_REASON},
    }
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
