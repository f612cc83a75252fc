"""Tells where a time is not the time of what is wished beside it.

An intent has one beginning and one end. "R3 out, from six it may be asked again" begins now, and
"the lorry comes in ten minutes, leave R3 out" does, too: such a beginning is asked back.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.words import text_at

_BARE = frozenset(
    """TIME a about also an and applies begin beginning begins beginnt bitte gilt goes heute i ich
    it its kicks moechte need now ok okay only please so start starting starts that the then
    this to today tomorrow tonight und von want will would zwar""".split()
)
"""Beside a beginning they say no more than that what is wished begins then."""
_ENDS_THEN = re.compile(
    r"\b(?:again|all|alle|allowed|available|back|can|charged|da|dabei|darf|done|duerfen|egal|"
    r"every(?:body|one)|fertig|fine|finished|fit|free|frei|higher|in|koennt|lower|may|mit|no limit|"
    r"ok|okay|over|ready|rein|verfuegung|wieder|with|zurueck)\b"
)
"""Said of a beginning: what is wished ends then."""
_TELLS = re.compile(
    r"\b(?:has|hasnt|have|havent|ive|weve) (?:not )?[a-z]+(?:ed|en) TIME$|\bworked TIME$|"
    r"\bwill be TIME late$|\bill be TIME\b|\b(?:braucht|needs?|takes?) TIME (?:for every|"
    r"fuer (?:eine|jede)|to (?:answer|reply))\b"
)
"""Tells how long something took, or has been so."""
_AS_WELL = re.compile(r"\b(?:also|as well|auch|too)\b")
_NOW = re.compile(r"\b(?:jetzt|now)\b")
_ONLY_FROM = re.compile(r"\bROBOT (?:nur|only) TIME\b")
_FROM_THEN = re.compile(r"\b(?:ab (?:da|dann|diesem)|from th(?:at|en)|von da an)\b")
_THEN = re.compile(r"\bTHEN\b")
"""They point to a time that is told before."""


def doubt_spans(draft: Draft) -> None:
    """Asks back about beginnings that belong to something else than what is wished."""
    wishes = [_wishes(draft, at) for at in range(len(draft.clauses))]
    if not any(wishes) or _points(draft):
        return
    whens = [m.when for m in draft.text.mentions if m.when is not None and m.when.clear]
    ended = any(when.start is None and (when.until or when.lasts) for when in whens)
    for at, clause in enumerate(draft.clauses):
        other = any(wishes[:at]) or any(wishes[at + 1 :])
        if other and _TELLS.search(clause.text):
            draft.firm.append(draft.text.whole)
        numbers = [n for n in draft.of(clause, "time") if _begins(draft, n)]
        if not numbers:
            continue
        first = draft.text.mentions[numbers[0]].first
        off = text_at(draft.text.words, first) == "in"
        if wishes[at]:
            before = draft.clauses[:at]
            apart = any(wishes[:at]) and (
                _AS_WELL.search(clause.text) or any(_NOW.search(c.text) for c in before)
            )
            ends = off and other and _ENDS_THEN.search(clause.text)
            doubted = bool(apart or ends or _ONLY_FROM.search(clause.text))
        else:
            bare = {*clause.text.split()} <= _BARE
            ends = not ended and _ENDS_THEN.search(clause.text)
            doubted = not bare and bool(off or ends)
        if doubted:
            draft.firm.append(draft.text.whole)


def _wishes(draft: Draft, at: int) -> bool:
    """Whether clause number `at` wishes something of what it names, or of nobody at all."""
    named = (draft.roles[n] for n in draft.clauses[at].mentions)
    own = any(role not in (None, "none", "doubt", "when") for role in named)
    return own or (draft.nobody and at in draft.handled)


def _begins(draft: Draft, number: int) -> bool:
    """Whether a time only is a beginning."""
    when = draft.text.mentions[number].when
    counts = when is not None and draft.roles[number] == "when"
    return counts and when is not None and when.start is not None and when.until is None


def _points(draft: Draft) -> bool:
    """Whether what is wished begins at a time that was told before: "from then on"."""
    said = " ".join(word.text for word in draft.text.words)
    return bool(_FROM_THEN.search(said)) or any(_THEN.search(c.text) for c in draft.clauses)
