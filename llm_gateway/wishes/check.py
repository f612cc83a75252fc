"""Holds what a model says of a wish against what its words say.

What words plainly say stands: on a thousand wishes that people wrote, a model's veto prevented
nothing and asked back what was plain. Nothing hard counts on the model's word alone; where words
only suggest that a robot is out, the model may confirm it. That a place or a class counts more, and
saving, are read back before they count: there the model's word is enough, beside a wish that words
say. That one counts less it is wrong about too often.
"""

from __future__ import annotations

from dataclasses import replace

from llm_gateway.wishes.names.mention import Kind
from llm_gateway.wishes.names.mentions import Text
from llm_gateway.wishes.reading import Reading, Role

_SOFT = {"place", "class", "network", "compute"}


def agreed(text: Text, plain: Reading, said: Reading) -> Reading:
    """The rules' reading, with what the model's adds to it."""
    wished = plain.nobody or any(role not in ("none", "doubt", "when") for role in plain.roles)
    doubted = plain.verdict == "nothing" and plain.unclear
    if doubted or (said.verdict == "nothing" and not wished):
        nothing = tuple[Role, ...]("none" for _ in plain.roles)
        asked = (text.whole,)
        return replace(plain, roles=nothing, verdict="nothing", unclear=asked)
    # What is wished of the network is said by its part.
    parted = {"network"} if {"link", "free"} & {*plain.roles} else set[Kind]()
    suspected = plain.suspected or (None,) * len(plain.roles)
    whole = said.verdict == "all" and not plain.nobody
    roles: list[Role] = []
    for mention, rule, model, likely in zip(
        text.mentions, plain.roles, said.roles, suspected, strict=True
    ):
        fills = wished and mention.kind in _SOFT - parted
        if rule == "doubt" and model == likely == "out":
            roles.append("out")
        elif rule == "none" and fills and (model == "high" or (model == "save" and whole)):
            roles.append(model)
        else:
            roles.append(rule)
    return replace(plain, roles=tuple(roles))
