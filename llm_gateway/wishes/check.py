"""Holds what a model says of a wish against what its words say.

Nothing hard counts on the model's word alone: words must say it. Where both say different things,
or the model sees no wish at all, the swarm asks. Weights only weigh: beside a wish that words say,
the model's word for another is enough.
"""

from __future__ import annotations

from dataclasses import replace

from llm_gateway.wishes.mention import Mention
from llm_gateway.wishes.mentions import Text
from llm_gateway.wishes.reading import Reading, Role

_SOFT = {"place", "class", "network", "compute"}


def agreed(text: Text, plain: Reading, said: Reading) -> Reading:
    """What the rules' reading and the model's have in common, with their differences in doubt."""
    doubted = plain.verdict == "nothing" and plain.unclear
    if doubted or (said.verdict == "nothing" and not _wishes(plain)):
        none: Role = "none"
        roles = tuple(none for _ in plain.roles)
        return replace(plain, roles=roles, verdict="nothing", unclear=_whole(text))
    fills = _wishes(plain)
    roles = tuple(
        _agreed(mention, rule, model, fills=fills)
        for mention, rule, model in zip(text.mentions, plain.roles, said.roles, strict=True)
    )
    unclear = (*plain.unclear, *_whole(text)) if said.verdict == "nothing" else plain.unclear
    return replace(plain, roles=roles, unclear=unclear)


def _agreed(mention: Mention, rule: Role, model: Role, *, fills: bool) -> Role:
    if model in (rule, "none") or mention.kind == "time":
        # Code alone knows times; and a model misses more than it finds.
        return rule
    if rule == "none" and mention.kind in _SOFT and fills:
        return model
    return "doubt"


def _wishes(reading: Reading) -> bool:
    return any(role not in ("none", "doubt", "when") for role in reading.roles)


def _whole(text: Text) -> tuple[str, ...]:
    return (text.wish.strip()[:200],)
