"""A language model may put an explanation into other words, never into other facts."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ego_agent.knowledge.why.compose import Explanation
from ego_agent.knowledge.why.find import Found
from swarm.messages import ALGORITHMS, ChatMessage

SYSTEM = (
    "Rewrite these facts about a decision as a short paragraph of plain English for an operator. "
    "Use only these facts, their numbers and names as they stand. Add nothing."
)
MAX_CHARS = 4_000
_NUMBER = re.compile(r"\d+(?:[.,]\d+)*")
_WORD = re.compile(r"[^\W\d_][\w-]*")
_NUMERALS = {
    "zero", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven",
    "twelve", "half", "twice", "double", "dozen", "hundred", "thousand", "third", "quarter",
}  # fmt: skip
"""Numbers in words: the facts have figures."""


def question(explanation: Explanation) -> tuple[ChatMessage, ...]:
    """What to ask a model."""
    return (
        ChatMessage(role="system", content=SYSTEM),
        ChatMessage(role="user", content=explanation.text()),
    )


def known_names(found: Found) -> set[str]:
    """Robots, algorithms and policies that a model could mix up."""
    lines = [line for line in (found.line, found.before) if line is not None]
    robots = {robot for line in lines for robot in line.inputs.robots}
    sizes = {a for line in lines for one in line.inputs.robots.values() for a in one.sizes}
    return robots | sizes | {*ALGORITHMS} | {line.decision.policy for line in lines}


def fault(text: str, explanation: Explanation, names: Iterable[str]) -> str:
    """Why a model's words must not be shown, or nothing.

    Every number must stand among the facts with the same digits, in figures; every robot and
    algorithm of `names` that the words have must stand there, too, and whatever else looks like
    a name: a word with a figure, or with a capital amid a sentence.
    """
    facts = explanation.text()
    if not text.strip():
        return "it is empty"
    if len(text) > MAX_CHARS:
        return f"it has {len(text)} characters; allowed: {MAX_CHARS}"
    numbers, words = set(_NUMBER.findall(facts)), set(_WORD.findall(facts))
    for number in _NUMBER.findall(text):
        if number not in numbers:
            return f"the facts have no {number}"
    known = set(names)
    begins = {match.start() for match in re.finditer(r"(?:(?<=[.!?:] )|(?<=\n)|\A)\w", text)}
    for match in _WORD.finditer(text):
        word = match.group()
        if word in words:
            continue
        if word.lower() in _NUMERALS:
            return f"the facts say no {word!r} in words"
        named = word in known or any(c.isdigit() for c in word) or any(map(str.isupper, word[1:]))
        if named or (word[0].isupper() and match.start() not in begins):
            return f"the facts name no {word!r}"
    return ""
