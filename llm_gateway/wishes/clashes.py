"""Doubts what one clause wishes of the link or of a policy, and another one takes back."""

from __future__ import annotations

from collections.abc import Iterator

from llm_gateway.wishes.draft import Draft
from llm_gateway.wishes.mention import Mention
from llm_gateway.wishes.reading import Role


def doubt_clashes(draft: Draft) -> None:
    """Doubts policies that are to decide and not to decide, and what is to be saved or bounded and
    not to be."""
    _policies(draft)
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


def _roles(draft: Draft) -> Iterator[tuple[int, Mention, Role | None]]:
    """What is named, with its number and the role that it has until now."""
    pairs = zip(draft.text.mentions, tuple(draft.roles), strict=True)
    return ((number, mention, role) for number, (mention, role) in enumerate(pairs))
