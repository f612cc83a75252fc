"""Tells whether a clause says no to something."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues import common, weights

_NEEDLESS = re.compile(
    r"\b(?:no need|need ?nt|need not|dont (?:need|have) to|no reason to|nicht noetig|unnoetig|"
    r"(?:brauch\w*|muss\w*|muesst?) (?:\w+ ){0,3}(?:nicht|nich|ned|net))\b"
)


def bounds(text: str) -> str:
    """A clause without "no more than", which negates nothing and takes nothing back."""
    return re.sub(
        r"\b(?:no|not|nicht|never|dont use|dont take) (?:more|less|worse|higher|lower|mehr|weniger|"
        r"schlechter|hoeher)(?: than| als|(?= SHARE))|"
        r"\bno (?:need|matter|doubt|worries|rush|hurry|question|offen[cs]e)\b|"
        r"\bkeine (?:angst|bange|sorge)\b(?! (?:um|vor)\b)|"
        r"\bnever mind\b|\bnothing happen\w*\b|\bnix los\b|\bnichts los\b|"
        r"\blike (?:to|ROBOT)\b",
        "BOUND",
        text,
    )


def needless(text: str) -> bool:
    """Whether a clause says that something need not be done."""
    return bool(_NEEDLESS.search(text))


def denies(text: str) -> bool:
    """Whether a clause says no, or hardly, to what was said before it."""
    return bool(common.NOT.search(text) or weights.MINIMISED.search(text))


def negated(text: str) -> bool:
    """Whether a clause says no to something."""
    return bool(common.NOT.search(bounds(text)))
