"""Doubts what one clause wishes of the link or of a policy, and another one takes back."""

from __future__ import annotations

import re
from collections.abc import Iterator

from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.reading import Role

_IS_SHORT = re.compile(
    r"\bNET(?: \w+){0,2} (?:is|are|ist|sind|gets|has|hat|looks|laeuft|runs|seems|wirkt|"
    r"wird)\b(?! to\b)|"
    r"\b(?:got|gibt|haben?|hat|has|have) (?:\w+ )*NET\b"
)
"""Tells how the network is."""


def doubt_clashes(draft: Draft) -> None:
    """Doubts policies that are to decide and not to decide, and what is to be saved or bounded and
    not to be; a short network, of which a part is given, is no wish besides."""
    _policies(draft)
    _given(draft)
    _resources(draft)


def _policies(draft: Draft) -> None:
    wanted = {name for _, m, role in _roles(draft) for name in m.names if role == "policy"}
    for number, mention, _ in _roles(draft):
        if mention.kind != "policy":
            continue
        names = {*mention.names}
        if names & wanted & draft.denied:
            draft.roles[number] = "doubt"
        elif wanted and names <= draft.denied:
            draft.roles[number] = "none"  # Another one is to decide instead.


def _resources(draft: Draft) -> None:
    doubted = {m.kind for _, m, role in _roles(draft) if role == "doubt"}
    for number, mention, role in _roles(draft):
        bounded = role in ("link", "free") and "network" in doubted
        if bounded or (role == "save" and mention.kind in doubted):
            draft.roles[number] = "doubt"


def _given(draft: Draft) -> None:
    """ "The link is tight, use a quarter of it": the part says all that is wished of it."""
    if not {"free", "link"} & {*draft.roles}:
        return
    for clause in draft.clauses:
        if draft.of(clause, "share") or not _IS_SHORT.search(clause.text):
            continue
        numbers = draft.of(clause, "network")
        draft.set([n for n in numbers if n in draft.wasted or draft.roles[n] == "save"], "none")


def _roles(draft: Draft) -> Iterator[tuple[int, Mention, Role | None]]:
    """What is named, with its number and the role that it has until now."""
    pairs = zip(draft.text.mentions, tuple(draft.roles), strict=True)
    return ((number, mention, role) for number, (mention, role) in enumerate(pairs))
