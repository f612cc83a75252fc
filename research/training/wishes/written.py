"""Wishes that people wrote, as what a model reads and is to write."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.names.mentions import find
from llm_gateway.wishes.reading import Reading, Role, Verdict
from research.training.wishes.cases import Case
from research.training.wishes.samples import Sample
from swarm.messages.intent import Intent

_CLOSE = 0.005
"""Of parts: a third may be 0.33."""


def written(cases: Sequence[Case]) -> Iterator[Sample]:
    """Those of which every name is found and has one role."""
    for case in cases:
        text = find(case.wish, case.site, case.time)
        meant = case.meant
        roles = [_role(mention, meant) for mention in text.mentions]
        if not text.mentions or None in roles:
            continue
        said = tuple(role for role in roles if role is not None)
        verdict: Verdict = "part" if case.doubtful else "all"
        if meant.only == () and not case.doubtful:
            verdict = "nobody"
        elif meant.is_empty():
            verdict = "nothing" if not any(m.kind == "unknown" for m in text.mentions) else "part"
        yield Sample(case.language, case.site, case.time, text, Reading(said, verdict))


def _role(mention: Mention, meant: Intent) -> Role | None:
    """What an intent makes of a mention; None where it is of two minds."""
    match mention.kind:
        case "robot":
            return _of_robots({*mention.names}, meant)
        case "place" | "class":
            said = (
                dict(meant.classes)
                if mention.kind == "class"
                else {focus.place: focus.weight for focus in meant.focus}
            )
            weights = {said.get(name) for name in mention.names}
            weight = weights.pop()
            return None if weights else (weight or "none")
        case "share":
            return _of_share(mention, meant)
        case "network" | "compute":
            kind = "bandwidth" if mention.kind == "network" else "compute"
            return "save" if meant.save == kind else "none"
        case "policy":
            return "policy" if meant.policy in mention.names else "none"
        case "time":
            bound = meant.start or meant.until
            return "when" if bound and mention.when is not None and mention.when.clear else "none"
        case _:
            return "none"


def _of_robots(names: set[str], meant: Intent) -> Role | None:
    sets: dict[Role, set[str]] = {
        "out": {*meant.exclude}, "only": {*(meant.only or ())}, "first": {*meant.prefer},
    }  # fmt: skip
    for role, held in sets.items():
        if names & held:
            return role if names <= held else None
    return "none"


def _of_share(mention: Mention, meant: Intent) -> Role:
    value = 0.0 if mention.share is None else mention.share.value
    link = meant.link_share
    said: dict[Role, float | None] = {
        "quality": meant.q_min, "link": link, "free": None if link is None else 1 - link,
    }  # fmt: skip
    for role, part in said.items():
        if part is not None and abs(part - value) <= _CLOSE:
            return role
    return "none"
