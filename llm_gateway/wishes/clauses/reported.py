"""Tells which classes a wish names only to give its reason: "because people are out there"."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import asides

_IS = re.compile(r"\bCLASS (?:is|are|ist|sind|s)\b|\bCLASS (?:\w+ )*(?:ist|sind)$")


def only_reasons(draft: Draft) -> frozenset[int]:
    """The numbers of classes of which nothing is wished."""
    found: set[int] = set()
    for clause in draft.clauses:
        numbers = [n for n in draft.of(clause, "class") if draft.roles[n] in (None, "none")]
        if numbers and weight_role(clause.text) is None and _tells(draft, clause):
            found |= {*numbers}
    return frozenset(found)


def _tells(draft: Draft, clause: Clause) -> bool:
    """Whether a clause is but the reason of another one that wishes something."""
    if not _IS.search(clause.text):
        return False
    others = [c for c in draft.clauses if c is not clause and c.sentence == clause.sentence]
    wished = [n for c in others for n in c.mentions if draft.roles[n] not in (None, "none")]
    if clause.opener in asides.REASONS:
        return bool(wished)
    places = {name for n in draft.of(clause, "place") for name in draft.text.mentions[n].names}
    again = {name for n in wished for name in draft.text.mentions[n].names}
    return bool(places & again)
