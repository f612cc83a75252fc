"""Writes the words of a clause so that cues are found in them: in full, without slips, in one."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.cues.spelling import KNOWN, SPELLING
from llm_gateway.wishes.words import alike, exchanged

SHORTENED_INSIDE = {"bes": "besonders", "esp": "especially", "evtl": "", "ggf": "", "incl": "with",
               "inkl": "mit", "insb": "insbesondere"}  # fmt: skip
"""What is short for another word; no sentence ends behind it."""
_ABBREVIATED = {"garned": "gar nicht", "garnet": "gar nicht", "garnich": "gar nicht",
                "garnicht": "gar nicht", "lo": "low", "prio": "priority",
                "prios": "priority"}  # fmt: skip
_WHOLE = (
    (r"\b(?:nobody|no ?one) (?:is to|may|must|needs to|shall|should) (?=(?:ask|bother|call|contact|"
     r"disturb|ping|query|use)(?: (?:her|him|it|them|the|TIME|ROBOT))+$)", "dont "),
    (r"^((?:(?:and|den|der|die|sie|ROBOT) )+)(?:darf|muss|sollte?) (?:(?:bitte|mal|TIME) )*"
     r"(?:keiner|niemand) (?=(?:(?:an)?fragen|nutzen|(?:be)?nutzen|stoeren|behelligen|nehmen)$)",
     r"\1 bitte nicht "),
    (r"\b(nichts|nix) was\b", r"\1 das"),
    (r"\b(?:leave|keep|lass\w*) (?:it|them|das|es)"
     r" (?:like that|that way|at that|as it is|as is|so)\b", "SO"),
    (r"\b(?:(?:during|in|for|over) (?:that|this)(?: time)?|in that time|meanwhile|in der zeit|"
     r"waehrenddessen|so lange|solange|derweil|before then|bis dahin|till then|up to then|"
     r"until then)\b(?! as)",
     "THEN"),
    (r"(?:\b(?:use|take|nimm|ask) )?\b(?:all|every\w*|any\w*|alle[sn]?)(?: of)?(?: the| them)?"
     r"(?: others?| robots?| roboter| ones?| anderen)?(?: (?:im|in the) (?:fleet|pool|swarm|team))?"
     r"(?: (?:can|may|could|should|is allowed to|darf|duerfen|will)(?: be)?(?: [a-z]+)?| help| "
     r"helps)? (?:but|bar|barring|save|except|besides|apart|aside|excluding|other(?= than)|minus|"
     r"without|ausser|bis auf|ohne|abgesehen von|mit ausnahme von)"
     r"(?: for| from| than)?", "ALLBUT"),
    (r"\b(?:nobody|no ?one|none|nothing|no robot)(?: else| other)?(?: (?:gets|is|may be|shall be|"
     r"should be|to be) [a-z]+)? (?:but|except|than|besides|"
    r"other than|apart from)"
     r"(?: for)?", "NOBODYBUT"),
    (r"\b(?:niemand\w*|nichts|keine[rn]?)(?: ander\w+| sonst)? (?:ausser|als|bis auf)",
    "NOBODYBUT"),
)  # fmt: skip
"""What says "all but" belongs to what follows, whatever else its words say."""


def spelt(word: str) -> str:
    """A word without a slip, where it plainly is one of those that count."""
    if word in _ABBREVIATED:
        return _ABBREVIATED[word]
    if SHORTENED_INSIDE.get(word):
        return SHORTENED_INSIDE[word]
    if word in SPELLING or word in KNOWN or known(word):
        return word
    meant = [cue for cue in SPELLING if alike(word, cue)]
    if not meant:
        meant = [cue for cue in exchanged(word) if cue in KNOWN]
    return meant[0] if len(meant) == 1 else word


def whole_cues(text: str) -> str:
    """A clause in which what says "all but", or the like, is one word."""
    for pattern, capital in _WHOLE:
        text = re.sub(pattern, capital, text)
    return text
