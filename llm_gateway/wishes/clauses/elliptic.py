"""What a clause says by saying what the one before it said: "R3 too", "the ramp isn't", "X: Y!"."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import FILLERS, Draft
from llm_gateway.wishes.clauses.named import NEITHER
from llm_gateway.wishes.clauses.negations import denies
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.reading import Role

_BACK = 3
"""Clauses that one looks back."""
_THING = (
    r"(?:(?:the|der|die|das|den|and|und|but|aber|so) )*(?:ROBOT|PLACE|CLASS|NET|CPU)"
    r"(?: (?:at|in|on|by|near|around|am|im|an|auf|bei|beim)(?: (?:the|der|die|das|dem|den))? "
    r"PLACE)?"
)
_TOO = re.compile(
    rf"{_THING} (?:(?:is|are|ist|es|sind|do|does|can|goes|geht|bitte|please) )*"
    r"(?:too|also|auch|as well|likewise|ebenso|ebenfalls|genauso|dito|ditto|gleichfalls|sowieso|"
    r"the same|same)(?: (?:please|bitte|TIME))*|"
    rf"(?:also|auch|ebenso|likewise|ditto|dito|same (?:for|with)|the same (?:for|with|goes for)|"
    rf"and also|und auch|genauso|desgleichen) {_THING}"
    r"|(?:on|to|auf|fuer|for|with|mit|about|around|um|an|in|at)(?: (?:the|die|den|das|der))? "
    r"(?:PLACE|CLASS|NET|CPU)(?: CPU| NET)?(?: (?:too|also|auch|as well|noch dazu|sowieso|"
    r"obendrein|besides|either))+"
)
"""Says the same of what it names."""
_AND = {"and", "und"}
_WHO = re.compile(
    r"(?:(?:the|der|die|das|den|dem) )?ROBOT (?:who|whos|whose|which|der|die|das|dessen|deren)\b|"
    r"(?:(?:the|der|die|das|den|dem) )?ROBOT$"
)
"""Goes on with a list, and tells of each why."""
_MUCH = (
    r"(?:a (?:whole )?lot|lots|plenty|much|a great deal|loads|viel|sehr viel|jede menge|mehr|more)"
)
_NEEDS = (
    r"(?:needs?|gets?|deserves?|wants?|requires?|braucht|brauchen|bekommt|bekommen|kriegt|kriegen|"
    r"verdient|verdienen)"
)
_IS = re.compile(
    rf"{_THING} (?:(?:aber|dagegen|doch|hingegen|however|jedoch|though) )?"
    r"(?:is|are|ist|sind|does|do|schon|sehr wohl|dagegen schon|very much|viel|sehr|"
    rf"greatly|{_MUCH}|{_NEEDS} {_MUCH}(?: (?:more|mehr|of it|davon))?)"
)
"""Says the opposite, where the one before it said no or less."""
_LITTLE = re.compile(
    rf"{_THING} {_NEEDS} (?:(?:very |only |nur |sehr )?(?:little|less|wenig|weniger|none|keine|"
    r"hardly any|next to none|kaum)(?: of it| davon)?)"
)
"""Says the opposite, where the one before it said more."""


def read_elliptic(draft: Draft) -> None:
    """Gives roles to what clauses name that lean on another one."""
    for at, clause in enumerate(draft.clauses):
        if draft.void[at]:
            continue
        for kinds in (("robot",), ("place", "class"), ("network", "compute")):
            numbers = draft.of(clause, *kinds)
            if not numbers or any(draft.roles[n] is not None for n in numbers):
                continue
            role = _leans(draft, at, clause, kinds)
            if role is not None:
                draft.set(numbers, role)
    for at in range(len(draft.clauses) - 2, -1, -1):
        _head(draft, at)


def _leans(draft: Draft, at: int, clause: Clause, kinds: tuple[str, ...]) -> Role | None:
    before = _before(draft, at, kinds)
    if before in (None, "none", "doubt"):
        return None
    if _TOO.fullmatch(clause.text):
        return before
    if kinds == ("network", "compute"):
        return None
    if kinds == ("robot",):
        goes_on = clause.opener in _AND and _WHO.match(clause.text)
        return before if goes_on and not clause.opens else None
    if before == "low" and _IS.fullmatch(clause.text):
        return "high"
    if before == "high" and _LITTLE.fullmatch(clause.text):
        return "low"
    bare = {*clause.text.split()} <= FILLERS
    if bare and denies(clause.text):
        return "low" if before == "high" or NEITHER.search(clause.text) else None
    return None


def _before(draft: Draft, at: int, kinds: tuple[str, ...]) -> Role | None:
    """The one role that the last clause before it has which names something of these kinds."""
    for near in range(at - 1, max(-1, at - 1 - _BACK), -1):
        numbers = draft.of(draft.clauses[near], *kinds)
        if numbers:
            roles = {draft.roles[n] for n in numbers}
            return roles.pop() if len(roles) == 1 else None
    return None


def _head(draft: Draft, at: int) -> None:
    """ "The pit: people in there matter": what stands before a colon weighs as what follows."""
    clause, after = draft.clauses[at], draft.clauses[at + 1]
    numbers = draft.of(clause, "place", "class")
    open_ = numbers and all(draft.roles[n] is None for n in numbers)
    if not open_ or draft.void[at] or draft.void[at + 1] or after.sentence != clause.sentence:
        return
    bare = {*clause.text.split()} <= FILLERS and not denies(clause.text)
    roles = {draft.roles[n] for n in draft.of(after, "place", "class")}
    weighs = weight_role(after.text) is not None or after.opener == ":"
    if bare and weighs and len(roles) == 1 and roles <= {"high", "low"}:
        draft.set(numbers, roles.pop())
