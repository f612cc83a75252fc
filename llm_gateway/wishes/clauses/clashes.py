"""Doubts what one clause wishes and another one takes back, and bounds without a number."""

from __future__ import annotations

import re
from collections.abc import Iterator

from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.clauses.negations import negated
from llm_gateway.wishes.clauses.policies import settle_policies
from llm_gateway.wishes.cues import common, resources, robots
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.reading import Role
from llm_gateway.wishes.shares import QUALITY

_IS_SHORT = re.compile(
    r"\bNET(?: \w+){0,2} (?:is|are|ist|sind|gets|has|hat|looks|laeuft|runs|seems|wirkt|"
    r"wird)\b(?! to\b)|"
    r"\b(?:got|gibt|haben?|hat|has|have) (?:\w+ )*NET\b"
)
"""Tells how the network is."""
_ALL_OF_IT = re.compile(
    r"\b(?:all|entire|full|ganze\w*|gesamte\w*|volle\w*|whole)(?: of)?(?: (?:das|der|die|the))? "
    r"NET\b"
)


def doubt_clashes(draft: Draft) -> None:
    """Doubts policies that are to decide and not to decide, robots that are left out and demanded,
    and what is to be saved or bounded and not to be; a short network, of which a part is given, is
    no wish besides."""
    settle_policies(draft)
    _demands(draft)
    _alone(draft)
    _unbounded(draft)
    _given(draft)
    _resources(draft)


def _demands(draft: Draft) -> None:
    """ "Only R1. R2 must be asked too": nobody knows who else is to be left out. "Skip R1 and R2.
    Both must be asked": nobody knows who is out."""
    for at, clause in enumerate(draft.clauses):
        if not robots.DEMANDED.search(clause.text) or negated(clause.text):
            continue
        if common.PRONOUN.search(clause.text) and not draft.void[at]:
            near = [n for c in draft.clauses[max(0, at - 2) : at] for n in draft.of(c, "robot")]
            draft.set([n for n in near if draft.roles[n] == "out"], "doubt")
        numbers = [n for n in draft.of(clause, "robot") if draft.roles[n] in (None, "doubt")]
        if numbers:
            only = [number for number, role in enumerate(draft.roles) if role == "only"]
            draft.set([*numbers, *only] if only else [], "doubt")


def _alone(draft: Draft) -> None:
    """ "Only R1. Ask nobody but R2": doubts who alone is to be asked where two sentences differ."""
    alone = [(m, n) for n, m, role in _roles(draft) if role == "only" and m.kind == "robot"]
    of = {n: clause.sentence for clause in draft.clauses for n in clause.mentions}
    for mention, number in alone:
        for other, behind in alone:
            apart = of[number] < of[behind] and {*mention.names}.isdisjoint(other.names)
            draft.set([number, behind] if apart else [], "doubt")


def _unbounded(draft: Draft) -> None:
    """ "At most a bit of the link": doubts a bound of which no number was read."""
    for clause in draft.clauses if {"free", "link"} & {*draft.roles} else []:
        if _ALL_OF_IT.search(clause.text) and not negated(clause.text):
            draft.doubt(clause)
    linked = any(draft.linked(number) is not None for number in range(len(draft.roles)))
    for at, clause in enumerate(draft.clauses):
        bound = resources.AT_MOST.search(clause.text) or resources.AT_LEAST.search(clause.text)
        if draft.void[at] or at in draft.handled or not bound or draft.of(clause, "share"):
            continue
        open_ = [n for n in draft.of(clause, "network") if draft.roles[n] in (None, "none")]
        rated = any(QUALITY.fullmatch(word) for word in clause.text.split())
        if (open_ and not linked) or (rated and "quality" not in draft.roles):
            draft.doubt(clause, firmly=True)


def _resources(draft: Draft) -> None:
    doubted = {m.kind for _, m, role in _roles(draft) if role == "doubt"}
    for number, mention, role in _roles(draft):
        bounded = role in ("link", "free") and ("network" in doubted or _torn(draft, number))
        if bounded or (role == "save" and mention.kind in doubted):
            draft.roles[number] = "doubt"


def _torn(draft: Draft, number: int) -> bool:
    """ "At most 20 % of the link, but at least 60 % of it": whether another part is in doubt."""
    mine = draft.text.mentions[number].share
    for clause in draft.clauses:
        for other in draft.of(clause, "share") if draft.of(clause, "network") else []:
            said = draft.text.mentions[other].share
            if draft.roles[other] == "doubt" and mine and said and said.value != mine.value:
                return True
    return False


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
