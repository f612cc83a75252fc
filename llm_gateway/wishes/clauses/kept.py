"""Tells of robots that a wish only says to stay: "R1 stays in, leave R2 out".

Nothing is wished of them: all take part who are not left out. Beside a wish for other robots that
needs no question.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.reading import Role

_ROBOT = r"(?:(?:de[mnr]|die|das|the) )?ROBOT"
_BEFORE = r"(?:(?:aber|also|and|but|dagegen|hingegen|however|und|while) )*"
_BEHIND = (
    r"(?: (?:aber|again|anyway|as usual|auf jeden fall|bitte|dagegen|hingegen|however|please|"
    r"though|too|weiter(?:hin)?|whatever happens|wieder))*"
)
_STAYS = re.compile(
    rf"{_BEFORE}(?:(?:keep|leave) ROBOT (?:in|on|running)|"
    r"ROBOT (?:can|may|must|should) (?:stay(?: in| on)?|take part)|ROBOT (?:is in|remains(?: in)?|"
    r"stays(?: in| on)?)|ROBOT must not be missing|"
    rf"{_ROBOT} (?:bleibt|bleiben)(?: bitte)?(?: da| dabei| drin)?|"
    rf"{_ROBOT} (?:darf|duerfen|kann|koennen|muss|muessen|soll|sollen)(?: ruhig)? "
    r"(?:bleiben|dabeibleiben|drin ?bleiben|mitmachen)|"
    rf"{_ROBOT} drinlassen|"
    rf"{_ROBOT} (?:darf|duerfen) nicht fehlen|lass\w* {_ROBOT} (?:dabei|drin)){_BEHIND}"
)


def kept(draft: Draft) -> frozenset[int]:
    """The numbers of robots that only stay where they are, beside a wish for other ones; one that
    is left out as well is asked about."""
    wished = _named(draft, "doubt", "first", "only", "out")
    found: set[int] = set()
    for clause in draft.clauses:
        numbers = draft.of(clause, "robot")
        if clause.asked or len(numbers) != 1 or not _STAYS.fullmatch(clause.text):
            continue
        own = {*draft.text.mentions[numbers[0]].names}
        if own & _named(draft, "out"):
            draft.firm.append(draft.text.whole)  # "R1 can stay in, R1 out".
        again = [m for m in draft.text.mentions if m.kind == "robot" and own & {*m.names}]
        if len(again) == 1 and wished - own:
            found |= {*numbers}
    return frozenset(found)


def _named(draft: Draft, *roles: Role) -> set[str]:
    """The robots that have one of these roles."""
    return {
        name
        for mention, role in zip(draft.text.mentions, draft.roles, strict=True)
        if mention.kind == "robot" and role in roles
        for name in mention.names
    }
