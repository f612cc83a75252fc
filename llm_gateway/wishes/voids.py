"""Tells what is no wish: questions, reports, conditions, quotations, words of robots and texts."""

from __future__ import annotations

import re
from collections.abc import Sequence

from llm_gateway.wishes import cues
from llm_gateway.wishes.clauses import Clause
from llm_gateway.wishes.mentions import Text
from llm_gateway.wishes.roles import bounds

_GREETING = re.compile(
    r"^(?:(?:(?:hi|hello|hey)(?: there| all)?|hallo|ok|okay|well|so|please|bitte|also|servus|"
    r"moin|mate|na|uh) )+"
)


def foreign(text: Text) -> bool:
    """Whether these are the words of somebody who only is quoted."""
    said = " ".join(word.text for word in text.words)
    return bool(cues.FOREIGN.search(said))


def void(text: Text, clauses: Sequence[Clause], clause: Clause) -> bool:
    """Whether a clause asks, tells, supposes or takes back, rather than wishes."""
    opening = next(c for c in clauses if c.sentence == clause.sentence)
    asks = cues.QUESTION.match(_GREETING.sub("", opening.text))
    if asks and (clause.asked or not opening.text.startswith(("when", "where", "do ", "must"))):
        return True
    if cues.PAST.search(clause.text) or cues.DOUBTED.search(clause.text):
        return True
    if cues.CONDITION.search(cues.NO_CONDITION.sub("", clause.text)):
        return not ("reicht" in clause.text or "genuegt" in clause.text or _reaches(clause.text))
    named = any(text.mentions[n].kind != "time" for n in clause.mentions)
    return bool(cues.AGAIN.search(bounds(clause.text))) and (named or not clause.mentions)


def _reaches(text: str) -> bool:
    return bool(re.search(r"\b(?:mitmach\w*|dabei)\b", text))
