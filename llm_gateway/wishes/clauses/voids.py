"""Tells what is no wish: questions, reports, conditions, quotations, words of robots and texts."""

from __future__ import annotations

import re
from collections.abc import Sequence

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.negations import bounds
from llm_gateway.wishes.cues import asides, robots, speech
from llm_gateway.wishes.names.mentions import Text

_GREETING = re.compile(
    r"^(?:(?:(?:hi|hello|hey)(?: there| all)?|hallo|ok|okay|well|so|please|bitte|also|servus|"
    r"moin|mate|na|uh) )+"
)


_HELD = re.compile(
    r"\b(?:cut|dial|hang|held|hold|keep|kept|lean|pull|put|scale|sit|stay|step)\w* (?:\w+ )?back\b|"
    r"\bback (?:burner|door|office|off|seat|yard)\b"
)
"""Takes nothing back, though it says "back"."""
_SUPPOSES = re.compile(r"(?:if|unless|falls|sobald|sowie|wenn|as soon as|in case|sofern|once)\b")
"""Opens a sentence of which all is supposed."""
_ENOUGH = re.compile(r"\b(?:genuegt|reicht|(?:enough|genuegts|reichts) (?:if|when|wenn))\b")
"""What is supposed is all that is wished: "it is enough if R2 is asked"."""
_TAKES_PART = re.compile(r"\b(?:mitmach\w*|dabei)\b")
_CALLED = r"(?:(?:the|der|die|robot|roboter|unit|einheit|number|nummer) )*(?:ROBOT|UNKNOWN)\b"
_SPEAKER = re.compile(
    r"\b(?:this(?: here)? is|here(?: is| speaks)|hier (?:spricht|ist|redet|meldet sich)|i am|im|"
    r"ich bin|(?:my|the) name is|mein name ist|call me|ich heisse|according to|laut|gemaess|"
    r"(?:message|note|mail|email|signal|call|request|order|wish|greetings|nachricht|funkspruch|"
    r"meldung|wunsch|befehl|gruesse) (?:from|of|by|von)|on behalf of|im namen von|im auftrag von"
    rf") {_CALLED}|"
    r"\bROBOT (?:says|said|sagt|sagte|tells|told|speaking|speaks|calling|spricht|am apparat|"
    r"reporting|wants|requests?|asks|orders|commands|suggests|recommends|insists|begs|confirms|"
    r"writes|sends|informs|thinks|believes|complains|moechte|bittet|fordert|empfiehlt|schlaegt "
    r"vor|besteht|funkt|schickt|bestaetigt|teilt|meint|glaubt|befiehlt|meldet|reports?|here "
    r"[,.:!;]|hier [,.:!;]|over [,.:!;])|^(?:from |von )?ROBOT : (?:(?:the|der|die|robot|"
    r"roboter) )*(?:ROBOT|i|im|we|my|ich|wir|mein)\b"
)
"""A robot speaks, or somebody speaks for it."""
_MYSELF = re.compile(
    r"\b(?:ask|use|using|take|taking|trust|prefer|query|poll|choose|pick|include|exclude|ignore|"
    r"skip|drop|only|just|solely|except|but|than|besides|listen to|count on|rely on|start with|"
    r"stick to|stick with|without|fragt?|nehmt?|nimm|nutzt?|benutzt?|verwendet?|vertraut?|"
    r"bevorzugt?|nur|ausser|ohne|lasst|bloss|einzig|hoert auf|hoer auf|als|statt|instead of|over) "
    r"(?:(?:only|just|nur|always|immer|bitte|please|zuerst|allein|lieber) ){0,2}"
    r"(?:me|mich|mir|myself|us|uns)\b(?! (?:to|get|know|have|see|look|watch|make|zeigen|auf|das)"
    r"\b)|\b(?:my|our|mein\w*|unser\w*) (?:own |eigene[nr]? |lidar |camera )?(?:data|cameras?|"
    r"sensors?|sensing|lidar|view|readings?|detections?|observations?|picture|daten|kameras?|"
    r"sensor\w*|sicht|bild|messungen|beobachtungen|erkennung)\b|\b(?:we|us|wir|uns) (?:robots|"
    r"roboter)\b|\bi (?:see|detect|know|perceive) (?:it |them |everything )?(?:best|better|"
    r"most)\b|\bich (?:sehe|erkenne|weiss) (?:es |alles )?(?:am besten|besser|am meisten)\b"
)
"""The one who speaks is one of those who are asked: a robot."""


def foreign(text: Text) -> bool:
    """Whether these are the words of a robot, or of somebody who only is quoted."""
    said = asides.RELAYED.sub(" ", " ".join(word.text for word in text.words))
    corrected = re.search(r", (?:no|nein|nee|quatsch|wait|moment|halt) ,", said)
    if corrected or speech.CORRECTED.search(re.sub(r"[^a-z ]+ ?", "", said)):
        return True
    named = text.capitals("robot", "unknown")
    return bool(speech.FOREIGN.search(said) or _SPEAKER.search(named) or _MYSELF.search(named))


def tells(clauses: Sequence[Clause], clause: Clause) -> bool:
    """Whether a clause only reports what happened: a reason, at most, for a wish beside it."""
    opening = next(c for c in clauses if c.sentence == clause.sentence)
    return bool(
        speech.PAST.search(_plain(clause))
        and not clause.asked
        and not speech.QUESTION.match(_GREETING.sub("", opening.text))
        and not speech.DOUBTED.search(clause.text)
        and not speech.CONDITION.search(speech.NO_CONDITION.sub("", clause.text))
    )


def reasons(clause: Clause) -> bool:
    """Whether a clause that names nothing only tells why, or of whom."""
    return not clause.mentions and bool(
        clause.opener in asides.REASONS or asides.WHY.match(clause.text)
    )


def _plain(clause: Clause) -> str:
    plain = speech.POLITE.sub("", clause.text)
    return asides.WERE.sub(" ", plain) if clause.wished else plain


def supposes(clauses: Sequence[Clause], clause: Clause) -> bool:
    """Whether a clause says on what condition something is wished."""
    opening = next(c for c in clauses if c.sentence == clause.sentence)
    if clause is opening and _SUPPOSES.match(
        speech.NO_CONDITION.sub("", _GREETING.sub("", clause.text))
    ):
        return not _reaches(clause.text)
    if speech.CONDITION.search(speech.NO_CONDITION.sub("", clause.text)):
        return not (_ENOUGH.search(clause.text) or _reaches(clause.text))
    return False


def void(text: Text, clauses: Sequence[Clause], clause: Clause) -> bool:
    """Whether a clause asks, tells, supposes or takes back, rather than wishes."""
    opening = next(c for c in clauses if c.sentence == clause.sentence)
    asks = speech.QUESTION.match(_GREETING.sub("", opening.text))
    if asks and (
        clause.asked or not opening.text.startswith(("can we", "when", "where", "do ", "must"))
    ):
        return True
    if clause.asked and "TIME" not in opening.text and speech.ABLE.match(opening.text):
        return True
    supposed = speech.NO_CONDITION.sub("", _GREETING.sub("", opening.text))
    if _SUPPOSES.match(supposed) and not _reaches(opening.text):
        return True
    if speech.PAST.search(_plain(clause)) or speech.DOUBTED.search(clause.text):
        return True
    if speech.CONDITION.search(speech.NO_CONDITION.sub("", clause.text)):
        return not (_ENOUGH.search(clause.text) or _reaches(clause.text))
    kinds = {text.mentions[n].kind for n in clause.mentions}
    taken = speech.AGAIN.search(_HELD.sub(" ", bounds(clause.text)))
    if taken and taken[0] in ("again", "wieder") and not robots.UNUSED.search(clause.text):
        return False  # "is broken again".
    return bool(taken) and (not kinds or "robot" in kinds)


def _reaches(text: str) -> bool:
    """Whether what is supposed is that somebody takes part."""
    return bool(_TAKES_PART.search(text))
