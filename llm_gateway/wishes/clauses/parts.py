"""What a wish says of the parts that it names: bounds of quality and of the link."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.clauses.unbounded import unbounded
from llm_gateway.wishes.clauses.weighing import share_role
from llm_gateway.wishes.cues import asides, resources
from llm_gateway.wishes.reading import Role

_HOLDS = re.compile(
    r"\b(?:(?:as|so) long as|bis|given|provid(?:ed|ing)|till|until|waehrend|where|while)\b"
    r".*\b(?:are|exceeds?|faellt|falls|has|have|holds?|is|its|keeps|remains?|runs?|sits?|"
    r"s|stays|takes?|uses?)\b.* SHARE\b|"
    r"\b(?:THEN|bis|waehrend)\b.* SHARE(?: \w+)* (?:betraegt|bleib\w*|faellt|ha(?:t|ben)|is[st]?|"
    r"lieg\w*|sind|sinkt|steht|steigt)\b"
)
"""Tells how long, or where, a wish holds: no bound."""
_BIDS = re.compile(
    r"\b(?:at most|hoechstens|keep|max\w*|nehmt|no more|not|nutzt|take|(?<!they )(?<!we )use)\b"
)
"""Bounds it all the same."""
_OF_IT = re.compile(r"\b(?:of it|of that|davon)\b")


def read_parts(draft: Draft, at: int, clause: Clause) -> None:
    """Gives roles to the parts that clause number `at` names."""
    numbers = draft.of(clause, "share")
    if not numbers:
        return
    held = f"{clause.opener} {clause.text}"
    if _HOLDS.search(held) and not _BIDS.search(clause.text):
        draft.set(numbers, "doubt")
        return
    if len(numbers) > 1:
        _several_shares(draft, clause, numbers)
        return
    before_it = draft.clauses[at - 1]
    network = len(draft.of(before_it, "network")) == len(before_it.mentions)
    titled = at and clause.opener == ":" and network and before_it.sentence == clause.sentence
    role = share_role(clause.text)
    if role == "doubt" and titled:
        role = share_role(f"{before_it.text} {clause.text}")
    bounded = resources.AT_MOST.search(clause.text) or _OF_IT.search(clause.text)
    given = asides.GIVEN.search(clause.text) and not asides.OURS.search(clause.text)
    free = resources.FREE.search(clause.text) or (
        given and not resources.AT_MOST.search(clause.text)
    )
    if role == "doubt" and (bounded or free) and at:
        near = draft.clauses[max(0, at - 3) : at]
        said: Role = "free" if free else "link"
        before = [draft.linked(n) for c in near for n in draft.of(c, "share")]
        fits = all(part in (None, draft.linked(numbers[0], said)) for part in before)
        if any("NET" in c.text.split() for c in near) and fits:
            role = said
    if role == "doubt":
        role = _again(draft, numbers[0])
    _bound_share(draft, numbers[0], role, clause.text)


def _again(draft: Draft, number: int) -> Role:
    """ "Quality 0.85, so 0.85 it is": what the same part was said to be before."""
    share = draft.text.mentions[number].share
    before = {
        role
        for mention, role in zip(draft.text.mentions[:number], draft.roles, strict=False)
        if mention.share is not None and share is not None and mention.share.value == share.value
    }
    role = before.pop() if len(before) == 1 else None
    return role if role in ("quality", "link", "free") else "doubt"


def _several_shares(draft: Draft, clause: Clause, numbers: list[int]) -> None:
    """ "quality of 85 percent with at most half the link": each by the words around it."""
    *pieces, rest = clause.text.split("SHARE")
    pieces[-1] += f" {rest}"
    roles = [share_role(f"{piece} SHARE") for piece in pieces]
    if len(roles) != len(numbers) or len(set(roles)) != len(roles) or "doubt" in roles:
        roles = ["doubt"] * len(numbers)
    for number, role, piece in zip(numbers, roles, pieces, strict=False):
        _bound_share(draft, number, role, f"{piece} SHARE")


def _bound_share(draft: Draft, number: int, role: Role, said: str) -> None:
    share = draft.text.mentions[number].share
    bounds = share is not None and share.possible
    if bounds and role != "none":
        bounds = share is not None and not unbounded(said, share.value, role)
    draft.roles[number] = role if bounds else "doubt"
