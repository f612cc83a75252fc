"""Holds what a model says of a wish against what its words say.

What words plainly say stands: on a thousand wishes that people wrote, a model's veto prevented
nothing and asked back what was plain. Nothing hard counts on the model's word alone; where words
only suggest it, the model may confirm it. Weights of places and classes only weigh: beside a wish
that words say, the model's word that another counts more is enough; that one counts less it is
wrong about as often as not.
"""

from __future__ import annotations

from dataclasses import replace

from llm_gateway.wishes.mentions import Text
from llm_gateway.wishes.reading import Reading, Role

_SOFT = {"place", "class"}


def agreed(text: Text, plain: Reading, said: Reading) -> Reading:
    """The rules' reading, with what the model's adds to it."""
    doubted = plain.verdict == "nothing" and plain.unclear
    if doubted or (said.verdict == "nothing" and not _wishes(plain)):
        roles = tuple[Role, ...]("none" for _ in plain.roles)
        whole = (text.wish.strip()[:200],)
        return replace(plain, roles=roles, verdict="nothing", unclear=whole)
    fills = _wishes(plain)
    suspected = plain.suspected or (None,) * len(plain.roles)
    roles = tuple(
        _agreed(rule, model, likely, fills=fills and mention.kind in _SOFT)
        for mention, rule, model, likely in zip(
            text.mentions, plain.roles, said.roles, suspected, strict=True
        )
    )
    return replace(plain, roles=roles)


def _agreed(rule: Role, model: Role, likely: Role | None, *, fills: bool) -> Role:
    if rule == "doubt" and model == likely:
        return model
    return model if rule == "none" and model == "high" and fills else rule


def _wishes(reading: Reading) -> bool:
    return reading.nobody or any(role not in ("none", "doubt", "when") for role in reading.roles)
