"""Holds what a model says of a wish against what its words say.

Nothing hard counts on the model's word alone, nor on a cue's alone: robots, parts, times and
policies need both, and where they differ the words are unclear, which makes the swarm ask. Weights
and savings only weigh: where no cue speaks, the model's word is enough.
"""

from __future__ import annotations

from dataclasses import replace

from llm_gateway.wishes.mentions import Mention, Text
from llm_gateway.wishes.reading import Reading, Role

_SOFT = {"place", "class", "network", "compute"}


def agreed(text: Text, plain: Reading, said: Reading) -> Reading:
    """What the rules' reading and the model's have in common, with their differences in doubt."""
    doubted = plain.verdict == "nothing" and plain.unclear
    if doubted or (said.verdict == "nothing" and not _wishes(plain)):
        none: Role = "none"
        roles = tuple(none for _ in plain.roles)
        return replace(plain, roles=roles, verdict="nothing", unclear=_whole(text))
    roles = tuple(
        _agreed(mention, rule, model)
        for mention, rule, model in zip(text.mentions, plain.roles, said.roles, strict=True)
    )
    unclear = plain.unclear
    if said.verdict == "nothing" or (said.verdict == "part" and not unclear):
        unclear = (*unclear, *_whole(text))
    return replace(plain, roles=roles, unclear=unclear)


def _agreed(mention: Mention, rule: Role, model: Role) -> Role:
    if rule == model or rule == "doubt":
        return rule
    if mention.kind == "time":
        # Code alone knows times; the model may only doubt that one is the wish's.
        return "doubt" if rule == "when" else rule
    if mention.kind in _SOFT and rule == "none":
        return model
    return "doubt"


def _wishes(reading: Reading) -> bool:
    return any(role not in ("none", "doubt", "when") for role in reading.roles)


def _whole(text: Text) -> tuple[str, ...]:
    return (text.wish.strip()[:200],)
