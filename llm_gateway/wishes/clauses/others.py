"""Tells whether a part of the link is given to others than the swarm."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues import asides, resources
from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.reading import Role

_GIVES = (
    r"(?:allot|assign|donate|gebt?|geben|gib|give|goenn\w*|grant|hand|lass|lasst|lassen|leave|lend|"
    r"offer|schenk\w*|spendier\w*|ueberlass\w*)"
)
_KEEPS = r"(?:bewahr\w*|halt\w*|heb\w*|hold|keep|put|reserve|save|set|sicher\w*)"
_TO = re.compile(rf"\b{_GIVES} (?:bitte |mal |please )*((?:(?!SHARE)[\w'-]+ ){{1,6}})SHARE\b")
"""Who is given a part stands before it: "give the press half the link"."""
_FOR = re.compile(
    rf"\b(?:{_GIVES}|{_KEEPS}) (?:\w+ )?SHARE\b.*\b(?:an|for|fuer|to)"
    r" (?:(?:das|dem|den|der|die|our|the|unser\w*) ((?:[\w'-]+ ?){1,3})|(CLASS|others|them)\b)"
)
"""He stands behind it: "set aside half the link for the press"."""
_FOR_SWARM = re.compile(
    r"\bSHARE\b.*\b(?:for|fuer|to) (?:(?:den|die|our|the) )?"
    r"(?:beobachtungen|fleet|flotte|observations|perception|robots?|roboter|schwarm|swarm)\b"
)
"""What is kept free for the swarm may as well be what it may take."""
_MEANT = re.compile(
    r"\bSHARE\b.*\b(?:an|for|fuer|to) (?:(?:das|dem|den|der|die|the) )([\w'-]+)|"
    r"\bNET (?:an|at|auf|bei) SHARE\b"
)
"""Names somebody beside a part, or what it is of: nobody knows who gets it."""
_SOMEBODY = {"CLASS", "UNKNOWN", "denen", "ihnen", "them"}


def given_role(text: str) -> Role | None:
    """What a clause says of a part of the link by whom it gives it to; None: nothing."""
    most = resources.AT_MOST.search(text)
    if _FOR_SWARM.search(text) and resources.FREE.search(text):
        return "doubt"
    to = _TO.search(text)
    if to is not None and _is_other(to[1]):
        return "doubt" if most else "free"
    if most:
        return None
    kept = _FOR.search(text)
    if kept is not None and _is_other(kept[1] or kept[2]):
        return "free"
    meant = _MEANT.search(text)
    freed = resources.FREE.search(text) or asides.GIVEN.search(text)
    if meant is not None and meant[1] is None:
        return "doubt" if resources.FREE.search(text) else None
    return "doubt" if meant is not None and not freed and _is_other(meant[1]) else None


def _is_other(said: str) -> bool:
    """Whether words name somebody, and nobody of the swarm."""
    if asides.OURS.search(said) or "ROBOT" in said:
        return False
    words = said.replace("'", " ").split()
    return any(word in _SOMEBODY or (word.isalpha() and not known(word)) for word in words)
