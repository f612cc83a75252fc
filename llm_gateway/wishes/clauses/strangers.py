"""Asks back about things that a wish names and the site does not have: none is lost silently."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import ARTICLES, Clause
from llm_gateway.wishes.clauses.draft import THERE, Draft
from llm_gateway.wishes.clauses.negations import negated
from llm_gateway.wishes.clauses.roles import robot_role
from llm_gateway.wishes.clauses.voids import reasons
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import common, fleet, robots
from llm_gateway.wishes.cues.plain import unfamiliar

_LISTS = {"and", "or", "und", "oder", "sowie", "&", "+", "plus", "/"}
_THINGS = ("ROBOT", "PLACE", "CLASS")
_MOST = 9
"""Words of a clause that says one thing of one name."""
_IN = re.compile(
    r"\b([a-z]{4,}) (?:(?:walking|working|moving|standing|running|drin) )?(?:in|on|at|near|by|"
    r"around|under|behind|along|am|im|auf|aufm|bei|beim|bim|uf|vor|an|hinter|unter)"
    r"(?: (?:the|our|der|dem|den|die|das))? PLACE"
)
"""Something at a place, of which more is said than of the place."""
_WHERE = re.compile(
    r"\bCLASS (?:\w+ )?(?:in|on|at|near|by|around|behind|im|am|beim|in der|auf der|auf dem|an der) "
    r"(?:(?:the|our) )?(?!foot\b|duty\b|site\b|transit\b|risk\b|motion\b|"
    r"break\b)([a-z]{3,})\b(?! (?:of|shift|side|way|PLACE)\b)|"
    r"^(?:in|on|at|near|behind|im|am|beim|in der|auf der|auf dem|an der) "
    r"(?:(?:the|our) )?([a-z]{4,}) (?:are )?CLASS\b"
)
"""A class at something that is no place of the site."""
_SCENE = re.compile(
    r"\b(?:am|an|around|at|auf|aufm|bei|beim|bim|by|hinter|im|in|near|on|uf|unter|vor)"
    r"(?: (?:dem|den|der|die|our|the))? (?:[a-z]{1,2} - )?([a-z]{4,})\b|"
    r"^(?:[a-z]+ )??(?:das|der|die|our|the) ([a-z]{4,})\b|"
    r"^([a-z]{4,})(?: (?:are|is|ist|sind)\b|$)"
)
"""Tells of something, to which the clause behind it points."""
_THERE = re.compile(r"\b(?:da|dort|there|where|wo)\b")
"""Points to a place only, beside a class that may itself be "it"."""
_THEM = re.compile(r"\b(?:denen|die|ihm|ihnen|it|them|those)\b")
_THAN = re.compile(
    r"\bROBOT (?:rather than|instead of|over|before|ahead of|statt|anstatt|anstelle von|lieber als|"
    r"eher als) (?:(?:the|den|die|das) )?(?!\w+ing\b)([a-z]{3,})\b"
)
_WEIGHED = re.compile(
    r"(?:(?:the|die|der|das|den|and|und|also|auch|class|klasse|place|ort) )*([a-z]{4,}) "
    r"(?:(?:are|at|auf|bitte|count|counts|ganz|gewicht|go|is|ist|matter|matters|mit|on|please|sehr|"
    r"sind|to|very|weight|weighted|with|zaehlen|zaehlt) )*(?:down|egal|first|high|higher|"
    r"hoch|hoeher|important|less|low|lower|mehr|more|nach (?:oben|unten)|niedrig|niedriger|oben|"
    r"out|priority|rauf|raus|runter|top|unimportant|unten|unwichtig|unwichtiger|up|vorrang|weg|"
    r"weniger|wichtig|wichtiger|zuerst|zuoberst)(?: (?:bitte|gewichten|please|setzen|stufen))*"
)
_TELLS = re.compile(
    r"\b(?:is|are|was|were|has|have|hat|haben|wird|werden|ist|sind|s|sonst|otherwise|"
    r"keeps?|laeuft|laufen|rennt|rennen|faehrt|fahren|steht|stehen|arbeitet|arbeiten|regnet)\b"
)


def doubt_strangers(draft: Draft) -> None:
    """Asks back about clauses that wish something of a thing that the site does not have."""
    for at, clause in enumerate(draft.clauses):
        if draft.void[at] or at in draft.handled or reasons(clause):
            continue
        if (
            _listed(draft, at)
            or _somewhere(clause.text)
            or _rather(clause.text)
            or _pointed(draft, at)
            or _at_a_place(draft, clause)
            or _alone(draft, clause)
        ):
            draft.doubt(clause)


def _listed(draft: Draft, at: int) -> bool:
    """ "prefer X and R3", "R3 and X first": whether an unknown name stands in a list."""
    clause = draft.clauses[at]
    if clause.mentions and not _only_times(draft, clause):
        return False
    words = clause.text.split()
    before = draft.clauses[at - 1] if at else None
    after = draft.clauses[at + 1] if at + 1 < len(draft.clauses) else None
    acts = _acts(clause.text)
    if after is not None and after.sentence == clause.sentence and after.opener in _LISTS:
        first = next((word for word in after.text.split() if word not in ARTICLES), "")
        bare = len([word for word in words if word not in ARTICLES]) == 1
        if first in _THINGS and words and (acts or bare) and unfamiliar(words[-1]):
            return True
    if before is None or before.sentence != clause.sentence or clause.opener not in _LISTS:
        return False
    ends = before.text.split()[-1:]
    opening = next((word for word in words if word not in ARTICLES), "")
    alone = len([word for word in words if word not in ARTICLES]) == 1
    named = bool(ends) and ends[0] in _THINGS and unfamiliar(opening)
    return named and (acts or (alone and _role_of(draft, before)))


def _role_of(draft: Draft, clause: Clause) -> bool:
    """Whether a clause wishes something of the last thing that it names."""
    return bool(clause.mentions) and draft.roles[clause.mentions[-1]] not in (None, "none", "doubt")


def _at_a_place(draft: Draft, clause: Clause) -> bool:
    """ "watch the llamas in the orchard": the place alone is not what was meant."""
    names = {name for n in draft.of(clause, "place") for name in draft.text.mentions[n].names}
    elsewhere = {
        name
        for other in draft.clauses
        if other is not clause
        for n in draft.of(other, "place")
        for name in draft.text.mentions[n].names
    }
    if draft.of(clause, "class", "robot", "unknown") or names <= elsewhere:
        return False
    found = _IN.search(clause.text)
    if found is None or not weight_role(clause.text) or not unfamiliar(found[1]):
        return False
    many = found[1].endswith("s") and not found[1].endswith("ss")
    return many or _capital(draft, clause, found[1])


def _somewhere(text: str) -> bool:
    """ "people on the balcony matter": whether a class counts at a place that nobody knows."""
    found = _WHERE.search(text)
    return found is not None and bool(weight_role(text)) and unfamiliar(found[1] or found[2])


def _pointed(draft: Draft, at: int) -> bool:
    """ "The foundry is packed, be careful there": whether it is there where nobody knows."""
    clause, before = draft.clauses[at], draft.clauses[at - 1]
    if not at or before.sentence < clause.sentence - 1 or not _only_times(draft, before):
        return False
    if draft.of(clause, "place", "robot", "network", "compute", "share", "policy"):
        return False
    points = _THERE if draft.of(clause, "class") else THERE
    found = _SCENE.search(before.text)
    if found is None or weight_role(clause.text) is None:
        return False
    stands = found[3] and (clause.opener == ":" or _THEM.search(clause.text))
    alone = found[1] and found[0] == before.text and before.sentence == clause.sentence
    return unfamiliar(found[1] or found[2] or found[3]) and bool(
        stands or (not found[3] and (alone or points.search(clause.text)))
    )


def _rather(text: str) -> bool:
    """ "R3 rather than X": whether somebody unknown is what a robot is preferred to."""
    found = _THAN.search(text)
    return found is not None and unfamiliar(found[1])


def _alone(draft: Draft, clause: Clause) -> bool:
    """ "leave X alone", "X bitte schonen": whether a name is all of which a clause speaks."""
    text = clause.text
    if draft.of(
        clause, "robot", "place", "class", "unknown", "policy", "network", "compute", "share"
    ):
        return False
    if len(text.split()) > _MOST or common.PRONOUN.search(text) or fleet.OTHERS.search(text):
        return False
    found = _WEIGHED.fullmatch(text)
    if found and unfamiliar(found[1]):
        return True
    if not _asks(text) or _TELLS.search(text):
        return False
    return any(unfamiliar(word) and _capital(draft, clause, word) for word in text.split())


def _acts(text: str) -> bool:
    """Whether a clause wishes something of robots, or weighs something."""
    return _asks(text) or bool(robot_role(text, alone=True) or weight_role(text))


def _asks(text: str) -> bool:
    """Whether a clause leaves something out, or tries it first."""
    unused = robots.UNUSED.search(text) and negated(text)
    return bool(unused or robots.OUT.search(text) or robots.FIRST.search(text))


def _only_times(draft: Draft, clause: Clause) -> bool:
    return all(draft.text.mentions[n].kind == "time" for n in clause.mentions)


def _capital(draft: Draft, clause: Clause, word: str) -> bool:
    """Whether a word of a clause is written with a capital, as names are."""
    for said in draft.text.words[clause.first : clause.last]:
        if said.text == word:
            return draft.text.wish[said.start].isupper()
    return False
