"""What one clause says of how much things count, and of the parts that it names."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.negations import bounds
from llm_gateway.wishes.clauses.others import given_role
from llm_gateway.wishes.cues import asides, common, resources, robots, weights
from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.reading import Role
from llm_gateway.wishes.shares import QUALITY

_NO_LONGER = re.compile(r"\b(nicht|nich|ned|net|nid|not|no|nie) (?:mehr|more|any ?more|longer)\b")
_BOUNDED = re.compile(r"\b(?:at )?(?:least|less than|lower than|most) SHARE\b")
"""Says how much of something else, not how much a thing counts."""
_NOT_ENOUGH = re.compile(
    r"\b(?:cant|cannot|can not|kann\w*|koenn\w*) (?:\w+ )*(?:enough|genug|too careful|zu "
    r"vorsichtig)\b"
)
"""No to too little: "can't be watched enough"."""
_NO_PART = re.compile(
    r"\b(?:anything but|far from|alles andere als|nobodys?|no ?one|none|niemand\w*|nothing)\b"
    r"(?! (?:but|better|else|except|apart|besides|less|more|other|short)\b)"
)
_MAY = re.compile(r"\b(?:darf|duerfen|may|must|muss|should|soll\w*)\b")
_LOST = re.compile(
    r"\b(?:zero|null|ceas(?:es?|ed|ing) to|devoid of|lack(?:s|ed|ing)?|los(?:es?|t|ing)|verlier\w*|"
    r"verlor\w*|without|ohne) (?:(?:all|an|any|its|their|never|nicht|nie|no|not|jede\w*|"
    r"jegliche\w*|of) )*"
    r"(?=(?:bedeutung|gewicht|importance|interest|matter|prioritaet|priority|relevan\w+|"
    r"significance|weight|wichtigkeit)\b)"
)
"""No to what a clause says of a thing, by other words than "not"."""
_NOT_WITHOUT = re.compile(r"\b(?:not|nicht|keineswegs) (?:entirely |ganz )?(?:ohne|without)\b")
_LAPSES = re.compile(
    r"\b(?:drop|giv(?:e|es|ing) up|los(?:e|es|ing)|lower|relax)\w* (?:(?:all|any|our|the|your) )?"
    r"(?:attention|concentration|eyes?|focus|guard|vigilance)\b|"
    r"\b(?:avert|divert|draw|shift|tak(?:e|ing)|tear|turn)\w* (?:\w+ )?(?:attention|eyes?|focus|"
    r"gaze) (?:away|from|off)\b|"
    r"\blet (?:\w+ ){0,2}(?:attention|eyes?|focus|gaze|vigilance)(?: \w+){0,4} (?:drift|drop|fade|"
    r"lapse|slip|stray|wander|waver)\b|"
    r"\bverlier\w* .*\b(?:aufmerksamkeit|blick|fokus)\b|\baus dem (?:blick|fokus)\b|"
    r"\b(?:aufmerksamkeit|augen?|blick|fokus|konzentration)\b.* (?:abwend\w*|abzieh\w*|nachlass\w*|"
    r"verlier\w*|verlor\w*)|"
    r"\b(?:wend|zieh)\w* .*\b(?:aufmerksamkeit|augen?|blick|fokus)\b.* ab\b"
)
"""Ends what it names: "lose focus"."""
_KEPT_UP = re.compile(r"\b(?:do not|dont|must ?nt|must not|never|nicht|nie|niemals)\b")
_ALL_RIGHT = re.compile(
    r"\b(?:bad|egal|fine|hurt|matters?|mind|need|problem|schlimm|stoert|tragisch|worry)\b"
)
"""Beside "not" they say that it may be so."""
_UTMOST = re.compile(
    r"\b(?:could|can|koenn\w*)(?:nt| not| hardly| scarcely| nicht| kaum)* (?:\w+ )?"
    r"(more|less|\w*wichtiger)\b"
)
"""Can be no more, or no less: "could not be more important"."""
_LIKE = re.compile(
    r"\b(?:nichts|niemand|nix|nobody|no other \w+|nothing)\b.*\b(?:as|like|so|wie)\b.* "
    r"(?:PLACE|CLASS)"
)
"""Nothing is "as important as the docks"."""
_SHUT = re.compile(r"\bauge\w* (?:fest )?zu\w*\b|\bturn\w* a blind eye\b.*\b(?:not?|dont|never)\b")
_COMPARED = re.compile(
    r"\b(?:PLACE|CLASS) .*\b(?:vor|before|over|above|ahead of|outranks?) (?:(?:the|den|die|der|"
    r"dem) )?(?:PLACE|CLASS)\b|\b(?:than|als) (?:\w+ )?(?:PLACE|CLASS)\b"
)
_UNDER = re.compile(
    r"\b(?:above|below|hoechstens|less|mindestens|more|over|ueber|under|unter|weniger)\b"
)
_ABOVE = re.compile(
    r"\b(?:are|is|ist|s|sind|stays?) (?:\w+ )?(?:above|below|over|under)\b|\b(?:above|over|ueber)"
    r" SHARE\b|\bunter SHARE (?:ist|liegt|sind)\b"
)
"""Tells how much of the link is taken, rather than bounds it."""
_SOMEBODY = re.compile(
    r"\b(?:anyone|bots?|everyone|jeder|keiner|no one|nobody|roboter|robots?|wer|who\w*)\b"
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
    text = _BOUNDED.sub("SHARE", _NO_LONGER.sub(r"\1", text))
    if (superlative := _MOST_OF_ALL.search(text)) is not None:
        return "low" if re.match(r"less|weniger|unwichtig", superlative[1] or "") else "high"
    if (utmost := _UTMOST.search(text)) is not None and common.NOT.search(text):
        return "low" if re.match(r"less|unwichtig", utmost[1]) else "high"
    if _LAPSES.search(text):
        return "high" if _KEPT_UP.search(text) and not _ALL_RIGHT.search(text) else "doubt"
    if _LIKE.search(text):
        return "doubt" if weights.LOW.search(text) else "high"
    if (
        "ALLBUT" in text
        or _SHUT.search(text)
        or _COMPARED.search(text)
        or re.search(r"\b(?:nothing|nichts) .*\b(?:than|als)\b", text)
    ):
        return "doubt"
    text = _NOT_WITHOUT.sub("with", text)
    low = bool(weights.LOW.search(text))
    rest = weights.LOW.sub(" ", text) if low else text
    if low or not _MAY.search(text):
        rest = _NO_PART.sub("not", rest)
    if _LOST.search(rest):
        if common.NOT.search(rest):
            return "doubt"
        rest = _LOST.sub("not ", rest)
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


def _low_ones(text: str) -> bool:
    """ "Skip whoever is under 20 % charge": whether a clause wishes something of robots by how full
    they are."""
    acts = (robots.OUT, robots.UNUSED, robots.ONLY, robots.FIRST, _SOMEBODY)
    return bool(_UNDER.search(text)) and any(cue.search(text) for cue in acts)


def share_role(text: str) -> Role:
    """What a clause says of the part that it names."""
    words = set(text.split())
    quality = any(word in lexicon.QUALITY or QUALITY.fullmatch(word) for word in words)
    network = "NET" in words
    least, most = resources.AT_LEAST.search(text), resources.AT_MOST.search(text)
    falls = re.search(r"\b(?:below|under|unter)\b", text) and not (
        common.NOT.search(text) or "nothing" in words
    )
    bounded = most or least or common.NOT.search(text)
    if words & lexicon.BATTERY and "ROBOT" not in words and _low_ones(text):
        return "doubt"
    if words & lexicon.BATTERY or (asides.LOADED.search(text) and not bounded):
        return "none"
    if asides.STANDS.search(text) and not (bounded or asides.OURS.search(text)):
        return "doubt"
    if quality and not network:
        least = resources.AT_LEAST.search(resources.AT_MOST.sub(" ", text))
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
        if _ABOVE.search(text) and not (most or common.NOT.search(text)):
            return "doubt"
        return "link"
    if not network and least and not most and not falls and not resources.FREE.search(text):
        return "quality"
    return "doubt"
