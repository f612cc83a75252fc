"""Weighs what a trained model says of a wish, by how sure it is, beside what its words say.

Words read what is plain and ask back the rest. The model reads nearly all, and is sometimes wrong,
but then it is seldom sure. What both say stands. What only the model says stands where it is sure,
and is asked back else; where they contradict each other, the person is asked.
"""

from __future__ import annotations

from dataclasses import replace

from llm_gateway.wishes.account import question, settle
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.names.mentions import Text
from llm_gateway.wishes.reading import Reading, Role

SURE = 0.9
"""How likely the model must find a word for it to count alone."""
_WHOLE = ("all", "nobody")
"""Verdicts by which nothing is left to ask."""


def weighed(text: Text, plain: Reading, said: Reading) -> Reading:
    """The rules' reading and the model's, put together; what must be asked back is in its
    `unclear`. `said`: with how likely each of its words is."""
    *each, whole = said.likely
    if said.verdict == "nothing" and whole >= SURE:
        nothing = tuple[Role, ...]("none" for _ in plain.roles)
        return Reading(nothing, "nothing", (_shortened(text),))
    sure = said.verdict in _WHOLE and whole >= SURE
    roles = tuple(
        _role(mention, rule, model, likely >= SURE, sure=sure)
        for mention, rule, model, likely in zip(
            text.mentions, plain.roles, said.roles, each, strict=True
        )
    )
    nobody = plain.nobody or (said.verdict == "nobody" and whole >= SURE)
    unclear = () if sure else plain.unclear
    if said.verdict == "part" and whole >= SURE and not unclear:
        unclear = (_shortened(text),)
    reading = replace(plain, roles=roles, unclear=unclear, nobody=nobody)
    if not sure:
        return settle(text, reading)
    # The model has read the whole wish, its numbers and asides, too.
    open_ = [
        question(text, mention)
        for mention, role in zip(text.mentions, roles, strict=True)
        if role == "doubt" or mention.kind == "unknown"
    ]
    return replace(reading, unclear=tuple(dict.fromkeys(open_)))


def _role(mention: Mention, rule: Role, model: Role, likely: bool, *, sure: bool) -> Role:
    """What a mention is meant to be. `likely`: whether the model is sure of its word; `sure`: of
    all of the wish."""
    if mention.kind == "unknown" or model == rule:
        return rule
    if mention.when is not None and mention.when.question:
        return rule  # What the clock says the model does not know.
    if rule not in ("none", "doubt"):
        return rule if model == "none" else "doubt"
    if model == "none":
        return "none" if likely and sure else rule
    return model if likely else "doubt"


def _shortened(text: Text) -> str:
    return text.wish.strip()[:200]
