"""What one clause says of how much things count, and of the parts that it names."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.negations import bounds
from llm_gateway.wishes.clauses.others import given_role
from llm_gateway.wishes.cues import asides, common, resources, weights
from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.numbers import QUALITY
from llm_gateway.wishes.reading import Role

_NO_LONGER = re.compile(r"\b(nicht|nich|ned|net|nid|not|no|nie) (?:mehr|more|any ?more|longer)\b")
_NOT_ENOUGH = re.compile(
    r"\b(?:cant|cannot|can not|kann\w*|koenn\w*) (?:\w+ )*(?:enough|genug|too careful|zu "
    r"vorsichtig)\b"
)
"""No to too little: "can't be watched enough"."""
_NOTHING = re.compile(
    r"\b(are|is|san|sind|ist|theres|theyre|thats|its)((?: \w+){0,2}) (?:nichts|nix|nothing)\b"
    r"(?= (?!(?:as|but|if|less|like|mehr|more|short|so|weniger)\b)\w)|"
    r"^()()(?:nichts|nix|nothing)(?= (?:to|zu)\b)"
)
"""It is not: "the ramp is nothing we need to see"."""
_SHUT = re.compile(r"\bauge\w* (?:fest )?zu\w*\b|\bturn\w* a blind eye\b.*\b(?:not?|dont|never)\b")
_COMPARED = re.compile(
    r"\b(?:PLACE|CLASS) .*\b(?:vor|before|over|above|ahead of|outranks?) (?:(?:the|den|die|der|"
    r"dem) )?(?:PLACE|CLASS)\b|\b(?:than|als) (?:\w+ )?(?:PLACE|CLASS)\b"
)
_MOST_OF_ALL = re.compile(
    r"\b(?:nothing|no other (?:area|class|part|place|spot|thing)|nowhere|nichts|nix)"
    r"(?: else| anderes)?(?: TIME)? (?:(?:beats|tops|trumps)|(?:is|ist|matters?|counts?|zaehlt|"
    r"wiegt|gilt|geht|comes?|kommt|needs?|deserves?|braucht|verdient|interessiert)"
    r"(?: (?:mich|mir|uns|me|us|to me|to us|being|TIME|derzeit|gerade|heute|jetzt|now|today))* "
    r"((?:(?:mehr|more|less|weniger)(?: (?:attention|aufmerksamkeit|critical|important|urgent|"
    r"watching|wichtig))?|wichtiger|dringender|unwichtiger) (?:als|than)|above|before|over|ueber|"
    r"vor))(?: (?:the|our|den|die|der|das|dem))? (?:PLACE|CLASS)"
    r"(?: (?:and|und) (?:PLACE|CLASS))?(?: (?:now|today|jetzt|heute|TIME))*$"
)
"""The most, or the least, of all: "nothing matters more than the docks"."""


def weight_role(text: str) -> Role | None:
    """What a clause says of the place or the class that it names."""
    text = _NO_LONGER.sub(r"\1", text)
    if (superlative := _MOST_OF_ALL.search(text)) is not None:
        return "low" if re.match(r"less|weniger|unwichtig", superlative[1] or "") else "high"
    if (
        "ALLBUT" in text
        or _SHUT.search(text)
        or _COMPARED.search(text)
        or re.search(r"\b(?:nothing|nichts) .*\b(?:than|als)\b", text)
    ):
        return "doubt"
    text = _NOTHING.sub(r"\1\2 not", text)
    low = bool(weights.LOW.search(text))
    rest = weights.LOW.sub(" ", text) if low else text
    high = bool(weights.HIGH.search(rest))
    no = bool(common.NOT.search(bounds(rest)))
    if high and _NOT_ENOUGH.search(rest):
        return "high"
    if low and high and no:
        return "doubt"
    if high and not low and weights.MINIMISED.search(rest):
        return "low"
    if low:
        return "high" if no else "low"
    if high:
        return "low" if no else "high"
    return None


def share_role(text: str) -> Role:
    """What a clause says of the part that it names."""
    words = set(text.split())
    quality = any(word in lexicon.QUALITY or QUALITY.fullmatch(word) for word in words)
    network = "NET" in words
    least, most = resources.AT_LEAST.search(text), resources.AT_MOST.search(text)
    falls = re.search(r"\b(?:below|under|unter)\b", text) and not (
        common.NOT.search(text) or "nothing" in words
    )
    if words & lexicon.BATTERY:
        return "none"
    if quality and not network:
        return "doubt" if (most and not least) or falls else "quality"
    if network and not quality:
        if asides.REPORTED.search(text) and not (most or asides.OURS.search(text)):
            return "doubt"
        if (kept := given_role(text)) is not None:
            return kept
        given = asides.GIVEN.search(text) and not (most or asides.OURS.search(text))
        if given or resources.FREE.search(text):
            return "doubt" if most and not least else "free"
        if least and not re.search(r"\b(?:under|unter|below|ueber|above|or less)\b", text):
            return "doubt"
        return "link"
    if not network and least and not most and not falls and not resources.FREE.search(text):
        return "quality"
    return "doubt"
