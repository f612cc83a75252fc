"""What a wish says of policies: which is to decide, and which is not."""

from __future__ import annotations

import re
from collections.abc import Iterator

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.clauses.negations import negated

_JUDGED = re.compile(
    r"\bPOLICY (?:(?:policy|strategy) )?(?:\w+ )??(?:is|was|ist|war|seems|works|worked|performs|"
    r"gave|gives|keeps|kept|made|makes|did|does|had|has|hat|hatte|macht\w*|picked|fails|"
    r"failed|crash\w*|spinnt\w*|liefert\w*|lief|lags?|struggl\w*)\b"
    r"(?! (?:to|the|your|our|in|on|what|zu|die|der|dran|am|best|better|fine|ok|okay|good|run|mal|"
    r"das|decid\w*|entscheid\w*)\b)"
)
"""Tells how good a policy is."""
_GIVEN_UP = re.compile(
    r"\b(?:ALLBUT|anstelle von|anstatt|away from|deaktivier\w*|disable|drop|forget(?: about)?|"
    r"get rid of|instead of|no more|not|nicht|no|ohne|over|quit|rather than|replace|statt|stop|"
    r"switch off|than|turn off|als|vergiss|vergesst|weg von|without|kein\w*)"
    r"(?: (?:the|den|der|das|die|using|dem))?$"
)
"""Before a policy's name they say that it is not to decide."""
_LEFT = re.compile(r"\b(?:from|von|vom)(?: (?:the|der|dem))?$")
"""So they do before the first of two."""
_PUT_OFF = re.compile(r"^(?: (?:policy|strategy|bitte|please|wieder))*"
                      r" (?:aus|ab|off|out|raus|weg)(?: (?:bitte|please|TIME))*$")  # fmt: skip
"""Behind it they do."""


def read_policies(draft: Draft, clause: Clause) -> None:
    """Gives roles to the policies that a clause names."""
    numbers = draft.of(clause, "policy")
    pieces = re.split(r"\bPOLICY\b", clause.text)
    for number, before, behind in zip(numbers, pieces, pieces[1:], strict=False):
        names = {*draft.text.mentions[number].names}
        several = len(numbers) > 1
        given_up = bool(_GIVEN_UP.search(before.strip()) or _PUT_OFF.match(behind.rstrip()))
        left = several and bool(_LEFT.search(before.strip()))
        refused = given_up or left or (not several and negated(clause.text))
        judged = not several and _JUDGED.search(clause.text)
        draft.denied |= names if refused else set()
        if refused or judged:
            draft.roles[number] = "none" if "policy" in draft.roles else "doubt"
        else:
            draft.roles[number] = "policy"


def settle_policies(draft: Draft) -> None:
    """Doubts policies that are to decide and not to decide; beside one that is to decide, those
    that are not, and what is told of one, need no question."""
    wanted = {name for _, names, role in _named(draft) for name in names if role == "policy"}
    told = {n for c in draft.clauses for n in draft.of(c, "policy") if _JUDGED.search(c.text)}
    for number, names, role in _named(draft):
        if names & wanted & draft.denied:
            draft.roles[number] = "doubt"
        elif wanted and role != "policy" and (names <= draft.denied or number in told):
            draft.roles[number] = "none"


def _named(draft: Draft) -> Iterator[tuple[int, set[str], str | None]]:
    """The policies that are named, with their numbers and the roles that they have until now."""
    pairs = zip(draft.text.mentions, tuple(draft.roles), strict=True)
    for number, (mention, role) in enumerate(pairs):
        if mention.kind == "policy":
            yield number, {*mention.names}, role
