"""JSON out of a model's words: without reasoning, code fences and chatter around it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, Literal

from llm_gateway.schemas import Schemas

MAX_CHARS = 100_000
MAX_TRIES = 16
"""Places where JSON might begin; each one can cost a reading of the rest."""

Reason = Literal["empty", "too_long", "no_json", "malformed", "schema"]

_REASONING = re.compile(r"<(think|thinking|reasoning)>.*?(</\1>|\Z)", re.DOTALL)
_REASONING_END = re.compile(r"</(?:think|thinking|reasoning)>")
_BEGIN = re.compile(r"[{\[]")


class AnswerError(Exception):
    """Words in which no answer was found; `reason` is its kind, for counting."""

    def __init__(self, reason: Reason, why: str) -> None:
        super().__init__(why)
        self.reason: Reason = reason


def extract(text: str, schema: str, schemas: Schemas) -> str:
    """The first JSON value of a text that follows a schema, as compact JSON.

    Reasoning in `<think>…</think>` is left out, also where its begin or end is missing.
    Raises AnswerError, and GatewayError `invalid` for a schema that cannot be evaluated.
    """
    if len(text) > MAX_CHARS:
        raise AnswerError("too_long", f"{len(text)} characters; allowed: {MAX_CHARS}")
    if not text.strip():
        raise AnswerError("empty", "no words at all")
    fault = ""
    for value in _values(text):
        try:
            compact = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
            compact.encode()
        except ValueError:  # infinite numbers, halves of characters
            continue
        found = schemas.fault(value, schema)
        if not found:
            return compact
        fault = fault or found
    if fault:
        raise AnswerError("schema", f"it does not follow the schema: {fault}")
    if _BEGIN.search(_spoken(text)):
        raise AnswerError("malformed", f"its JSON is truncated or malformed: {text[-80:]!r}")
    raise AnswerError("no_json", f"there is no JSON in it: {text[:80]!r}")


def _values(text: str) -> Iterator[Any]:
    """JSON values in a text: all of it, else what can be read from each brace on."""
    try:
        yield _decoder.decode(text)
        return
    except (ValueError, RecursionError):
        pass
    text = _spoken(text)
    at, tries = 0, 0
    while (begin := _BEGIN.search(text, at)) and tries < MAX_TRIES:
        tries += 1
        try:
            value, at = _decoder.raw_decode(text, begin.start())
        except (ValueError, RecursionError):
            at = begin.end()
        else:
            yield value


def _spoken(text: str) -> str:
    """A text without its reasoning."""
    return _REASONING_END.split(_REASONING.sub("", text))[-1]


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON")


_decoder = json.JSONDecoder(parse_constant=_no_constant)
