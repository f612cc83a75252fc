"""Tells which classes a wish names only to give its reason: "because people are out there"."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import STRONG, Draft
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import asides

_IS = re.compile(r"\bCLASS (?:is|are|ist|sind|s)\b|\bCLASS (?:\w+ )*(?:ist|sind)$")
_MENDS = re.compile(
    r"(?:(?:die|our|the|unsere) )?CLASS(?: (?:aus|from|in|of|vom|von)(?: \w+){1,2}?)? "
    r"(?:fix|flicken|install|machen|mend|pruefen|repair|reparieren|schrauben|service|warten)\b"
)
"""Tells what somebody works at."""
_COLLEAGUES = ("colleague", "folk", "guys", "kolleg", "lads")
_STORY = re.compile(
    r"(?:an?|eine?|irgendein|one|so ein|some) CLASS\b(?!.*\b(?:are|is|ist|sind)\b)"
    r"(?=.*\b(?:almost|beinahe|fast|fell|got|had|hat|nearly|ran|[a-z]{3,}ed)\b)"
)
"""Tells what one of a class did: "some bloke on a bike nearly fell"."""


def only_reasons(draft: Draft) -> frozenset[int]:
    """The numbers of classes of which nothing is wished."""
    found: set[int] = set()
    for clause in draft.clauses:
        numbers = [n for n in draft.of(clause, "class") if draft.roles[n] in (None, "none")]
        told = _STORY.match(clause.text) or _mends(draft, clause) or _tells(draft, clause)
        if numbers and weight_role(clause.text) is None and told:
            found |= {*numbers}
    return frozenset(found)


def _mends(draft: Draft, clause: Clause) -> bool:
    """ "die Kollegen vom Service machen ein Update": whether colleagues only are at work."""
    firsts = [draft.text.mentions[n].first for n in draft.of(clause, "class")]
    said = [draft.text.words[first].text for first in firsts]
    return bool(_MENDS.match(clause.text)) and said[0].startswith(_COLLEAGUES)


def idle(draft: Draft, clause: Clause) -> bool:
    """Whether a clause wishes nothing, and names nothing that a wish beside it does not name:
    "a box won't cry if you bump it, so boxes: low"."""
    if len(draft.of(clause, "place", "class")) != len(clause.mentions) or not clause.mentions:
        return False
    mentions = draft.text.mentions
    again = {
        name
        for other, void in zip(draft.clauses, draft.void, strict=True)
        for n in (() if void else draft.of(other, "place", "class"))
        for name in mentions[n].names
    }
    named = {name for n in clause.mentions for name in mentions[n].names}
    return named <= again and not STRONG.search(clause.text) and weight_role(clause.text) is None


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
