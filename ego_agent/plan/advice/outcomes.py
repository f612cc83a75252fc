"""What comes of a question to a language model, in a bounded set of words.

They label metrics and stand in the journal. docs/llm.md explains each.
"""

from __future__ import annotations

import unicodedata
from typing import Literal, get_args

from swarm.errors import GatewayCode, MessageError, RefusedError

Refused = Literal[
    "low_confidence", "unknown_robot", "infeasible", "too_many", "worse", "unreadable"
]
"""Why an answer that came is not followed."""
Outcome = Literal["adopted", "late", "no_gateway", Refused, GatewayCode]
"""Of a question: `late` and `no_gateway` had no answer, the gateway's codes are its refusals."""
Ended = Literal["replaced", "too_old", "no_gateway", Refused]
"""Why advice that was in force is not any more; `replaced` by newer advice."""

OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
ENDED: tuple[Ended, ...] = get_args(Ended)
_CODES: dict[str, GatewayCode] = {code: code for code in get_args(GatewayCode)}


def trouble(error: Exception, waited_s: float, deadline_s: float) -> tuple[Outcome, str]:
    """What it means that a question ended with an error, and the error in words.

    A refusal carries the gateway's code. Zenoh says at once that nobody serves a key, and only
    after the deadline that no answer came.
    """
    if isinstance(error, RefusedError):
        return _CODES.get(error.code, "failed"), f"refused: {plain(error.reason)}"
    if isinstance(error, MessageError):
        return "unreadable", plain(str(error))
    return ("late" if waited_s >= deadline_s / 2 else "no_gateway"), plain(str(error))


def plain(text: str, length: int = 300) -> str:
    """Text from outside as one line for people: control and formatting characters, which could
    rewrite a terminal's or a log's line, are gone, and it is cut."""
    kept = (" " if unicodedata.category(c)[0] in "CZ" else c for c in text[: 4 * length])
    return " ".join("".join(kept).split())[:length]
