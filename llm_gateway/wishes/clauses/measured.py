"""Tells which numbers of a wish only tell how things are: "300 ms late", "ticket CHG-5512"."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.clauses.negations import negated
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import common, fleet, resources, robots, speech
from llm_gateway.wishes.cues.asides import STATES
from llm_gateway.wishes.cues.plain import unfamiliar
from llm_gateway.wishes.names.lexicon import QUALITY, ROBOT_WORDS
from llm_gateway.wishes.names.mentions import Text
from llm_gateway.wishes.numbers import is_physical
from llm_gateway.wishes.times.lengths import LASTS
from llm_gateway.wishes.words import text_at

_NUMBER = re.compile(r"\d[\d.,]*")
_LEAST = 3
_LONG = 4
"""Digits of a number that is no robot's, an hour's or a part."""
_ALONE = 2
"""Words of a number and its unit."""
_SHORT = {"m", "s"}
"""Units that are short for minutes and seconds as well."""
_IS_OVER = re.compile(
    r"\b(?:are|is|ist|liegt|s|sind) (?:\w+ )??(?:above|below|over|ueber|under|unter|up to)\b"
)
"""Tells how much something is, rather than how much it may be."""
_BOUNDS = re.compile(r"\b(?:faster|langsamer|limit|mehr als|more than|schneller|slower)\b")


def measured(draft: Draft) -> frozenset[int]:
    """The words that are numbers of which nothing can be wished."""
    text = draft.text
    inside = {at for m in text.mentions for at in range(m.first, m.last)}
    acts = [_acts(c, others=n in draft.handled) for n, c in enumerate(draft.clauses)]
    pointed = any(
        common.PRONOUN.search(clause.text) and (acting or weight_role(clause.text))
        for acting, clause in zip(acts, draft.clauses, strict=True)
    )
    return frozenset(
        at
        for number, clause in enumerate(draft.clauses)
        for at in range(clause.first, clause.last)
        if at not in inside
        and _NUMBER.fullmatch(text.words[at].text)
        and _is_told(text, at, clause, acts=acts[number], named=not pointed)
    )


def _is_told(text: Text, at: int, clause: Clause, *, acts: bool, named: bool) -> bool:
    """Whether a number tells how things are. `acts`: its clause may wish something; `named`: no
    other clause may point to a thing of that number."""
    behind = text_at(text.words, at + 1)
    if _is_code(text, at):
        return not negated(clause.text) and (not acts or len(text.words[at].text) >= _LONG)
    if is_physical(text.words, at + 1):
        lasts = text_at(text.words, at - 1) in LASTS or len(clause.text.split()) == _ALONE
        return not (_bounded(clause) or (behind in _SHORT and lasts))
    tells = STATES.search(clause.text) or speech.HAPPENED.search(clause.text)
    if acts or not tells or behind in ROBOT_WORDS:
        return False
    joined = behind == "-" and text.words[at + 1].start == text.words[at].end
    counted = [text_at(text.words, n) for n in range(at + 1 + joined, at + 3 + joined)]
    if not STATES.fullmatch(counted[0]) and any(unfamiliar(word) for word in counted):
        return True
    return named and _is_numbered(text, at)


def _is_numbered(text: Text, at: int) -> bool:
    """Whether a number stands behind a thing's name: "GPU node 2"."""
    before = text.words[at - 1] if at else None
    return before is not None and before.end < text.words[at].start and unfamiliar(before.text)


def _is_code(text: Text, at: int) -> bool:
    """Whether a number goes on with capital letters: "CHG-5512", "INC 20817", "A350"."""
    words, digits = text.words, len(text.words[at].text)
    if not words[at].text.isdigit() or at == 0:
        return False
    before = at - 2 if words[at - 1].text == "-" else at - 1
    if before < 0 or not words[before].text.isalpha():
        return False
    said = text.wish[words[before].start : words[before].end]
    glued = words[before].end + (before == at - 2) == words[at].start
    letters = 1 if glued and digits >= _LEAST else 2
    return said.isupper() and len(said) >= letters and (glued or digits >= _LEAST)


def _acts(clause: Clause, *, others: bool) -> bool:
    """Whether a clause may wish something of robots, or bounds something."""
    plain = fleet.REST.sub(" ", clause.text, count=1) if others else clause.text
    cues = (robots.OUT, robots.ONLY, robots.FIRST, robots.UNUSED)
    return _bounded(clause) or any(cue.search(plain) for cue in cues)


def _bounded(clause: Clause) -> bool:
    plain = _IS_OVER.sub(" ", clause.text)
    if QUALITY & {*plain.split()}:
        return True
    return any(cue.search(plain) for cue in (resources.AT_LEAST, resources.AT_MOST, _BOUNDS))
