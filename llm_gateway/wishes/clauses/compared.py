"""Tells of a robot that it only is what another one is preferred to: "R2 before R3"."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import ARTICLES
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.names.mentions import Text

_THAN = (["als"], ["than"], ["statt"], ["over"])
_BEFORE = re.compile(
    r"(?:(?:,|asked|bitte|first|please|polled|taken|tried|used|zuerst) )*(?:ahead of|before|"
    r"vor)(?: (?:dem|den|der|the))?"
)
"""Between two robots: the first one is preferred."""
_GOES_ON = frozenset(
    """aber also and as auch bis bitte but falls for from fuer heute if jetzt now please sowie till
    today too und until wenn when where""".split()
)
"""Behind the second one they begin something else."""


def is_compared(text: Text, mention: Mention) -> bool:
    """Whether it only is what something else is preferred to: "rather R2 than R3", "R2 vor R3"."""
    for other in text.mentions:
        near = [word.text for word in text.words[max(0, other.first - 3) : other.first]]
        cue = [word for word in near if word not in ARTICLES][-1:]
        same = other.kind == "robot" and other.names == mention.names
        if same and (cue in _THAN or _comes_behind(text, other)):
            return True
    return False


def _comes_behind(text: Text, mention: Mention) -> bool:
    """Whether a robot stands behind another one and "before", and no more is said of it."""
    behind = text.words[mention.last].text if mention.last < len(text.words) else "."
    if behind[0].isalnum() and behind not in _GOES_ON:
        return False  # "R2 before R3 goes".
    ends = [other.last for other in text.mentions if other.kind == "robot"]
    begin = max((end for end in ends if end <= mention.first), default=mention.first)
    said = " ".join(word.text for word in text.words[begin : mention.first])
    return bool(_BEFORE.fullmatch(said))
