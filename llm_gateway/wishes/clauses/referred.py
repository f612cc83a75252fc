"""What a clause of a wish says of something that is named beside it: of "it", "both", "there"."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import FILLERS, POINTS, THERE, Draft
from llm_gateway.wishes.clauses.negations import needless, negated
from llm_gateway.wishes.clauses.roles import others_role, robot_role
from llm_gateway.wishes.clauses.voids import tells
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import common, fleet, resources, robots
from llm_gateway.wishes.cues.plain import strange, unknown_thing
from llm_gateway.wishes.reading import Role

_ONLY_FIRST = re.compile(r"(?:\w+ ){0,2}(?:only|just|nur|bloss|ask|use|fragt?|nimm|nehmt)\b")
_OVER = {"out", "over", "over and out", "ende", "end"}
"""Ends what is said by radio."""
_LEFTOVER = re.compile(
    r"\b(?:gets?|has|have|takes?|keeps?|for|fuer|bekomm\w*|krieg\w*|nimmt|nehmen|brauch\w*|needs?) "
    r"(?:the |den |das )?(?:rest|remainder|uebrige)$|\b(?:rest|remainder) (?:is|goes|geht|ist|"
    r"bleibt) (?:for|to|fuer|an|bei)\b|\bhave the rest$"
)
"""Tells who gets the part of the link that is kept free."""
_ALWAYS = {"always", "always please", "bitte immer", "immer", "immer bitte"}
"""Alone they change nothing of what was just said: "R2 first, always"."""
_NO = {"nein", "no", "nope"}
_AFTER = {"then", "dann"}
"""Before the others they say that who is named comes first."""
_DECIDES = re.compile(
    r"\b(?:let|have|lass\w*|soll\w*|should|may|can) (?:\w+ )?(?:it|that|them|this|das|die|es|sie|"
    r"diese)\b(?: \w+){0,3} (?:decid\w*|choos\w*|run|do|pick|entscheid\w*|waehl\w*|laufen|machen|"
    r"ran)\b"
)
"""Says when a policy decides that is named beside it."""
_FALLS = re.compile(
    r"\b(?:accuracy|genauigkeit|guete|it|precision|qualitaet|quality|sie)(?: \w+)? (?:can|darf|"
    r"kann|may) (?:\w+ )??(?:abfallen|absinken|decrease|dip|drop|fall|go down|nachgeben|runter|"
    r"runtergehen|sink|sinken|suffer)\b"
)
"""Lets quality fall, to a bound that is said beside it."""
_BELOW = re.compile(
    r"\b(?:darunter|drunter|below (?:that|this|it)|under (?:that|this|it)|less than that|lower "
    r"than that|nothing (?:below|under|less|lower)|nichts (?:darunter|drunter))\b"
)
"""Says again that quality may not fall below a bound."""


_THEY = re.compile(
    r"(?:he|it|its|she|they|theyre) [a-z]|(?:das|der|die|er|sie) [a-z]+(?:e[lr]?n|t)\b"
)
"""Begins to tell more of robots."""
_CAREFUL = re.compile(r"\b(?:careful|mindful|sorgsam|vorsichtig)\b")
"""Weighs a place as well as it saves something."""
_WEIGHS = re.compile(
    r"\b(?:attention|aufmerksamkeit|gewicht|gewichtung|importance|prioritaet|priority|vorrang|weight|"
    r"wichtigkeit)\b"
)
"""Said of what was just named, be it a place or a class: "give it high priority"."""


def read_referred(draft: Draft, at: int, clause: Clause) -> None:
    """Gives what a clause says of "it" to what was named before it, or right behind."""
    if clause.opener in _AFTER and fleet.REST.fullmatch(clause.text):
        _give(draft, at, "first", "robot")
    if fleet.REST.match(clause.text) and not _moved(clause.text):
        draft.handled.add(at)
        return
    parted = any(draft.linked(n) is not None for n in range(len(draft.roles)))
    settled = "policy" in draft.roles and _DECIDES.search(clause.text)
    floor = "quality" in draft.roles and (_BELOW.search(clause.text) or _FALLS.search(clause.text))
    if (settled or floor) and not draft.of(clause, "robot", "place", "class", "share", "unknown"):
        draft.handled.add(at)
        return
    if at and clause.text in _ALWAYS and draft.of(draft.clauses[at - 1], "robot"):
        draft.handled.add(at)
        return
    if parted and not clause.mentions and _LEFTOVER.search(clause.text):
        draft.handled.add(at)
        return
    if clause.text in _OVER and clause.opener != ":" and at + 1 == len(draft.clauses):
        draft.handled.add(at)
        return
    points = POINTS.match(clause.text) and not clause.mentions
    weighs = points and weight_role(clause.text) == "high"
    if weighs and _give(draft, at, "high", "place", "class"):
        draft.handled.add(at)
        return
    refused = at and clause.text in _NO and fleet.OTHERS.fullmatch(draft.clauses[at - 1].text)
    if refused and _give(draft, at, "only", "robot"):
        draft.handled.add(at)
        return
    if (role := others_role(clause.text)) is not None and not draft.of(
        clause, "robot", "share", "network", "compute", "policy"
    ):
        draft.handled.add(at)
        if not _give(draft, at, role, "robot"):
            draft.doubt(clause)
        return
    elsewhere = _CAREFUL.search(clause.text) and unknown_thing(clause.text)
    if resources.SAVE.search(clause.text) and not (clause.mentions or elsewhere):
        saves: Role = "doubt" if needless(clause.text) or negated(clause.text) else "save"
        if _give(draft, at, saves, "network", "compute"):
            draft.handled.add(at)
            return
    weighed = draft.of(clause, "place", "class")
    both = common.BOTH.search(clause.text) and not draft.of(clause, "robot") and not weighed
    if both and (role := robot_role(clause.text, alone=True)) is not None:
        for near in draft.clauses[max(0, at - 4) : at]:
            draft.set([n for n in draft.of(near, "robot") if draft.roles[n] is None], role)
    others = any(draft.text.mentions[n].kind != "time" for n in clause.mentions)
    named = draft.of(clause, "robot", "share", "network", "compute")
    pointed = common.PRONOUN.search(common.BOTH.sub(" ", clause.text) if weighed else clause.text)
    if not others or (pointed and not named):
        weighs = not clause.mentions and _weighs_thing(draft, at, clause)
        role = None if weighs else _pointed_role(draft, clause, pointed=bool(pointed))
        ailing = role == "out"
        sure = role not in ("out", "only") or not strange(clause.text, ailing=ailing)
        told = role == "only" and not sure and {"out", "first"} & {*draft.roles}
        if role == "out" and not sure and _slips(draft, at):
            draft.handled.add(at)
            return
        if role is not None and not told and not (sure and _give(draft, at, role, "robot")):
            draft.doubt(clause)
        elif role == "out" and not told and not pointed:
            return  # "R3 is stuck at the docks, leave out".
    if not draft.of(clause, "place", "class") and not draft.of(clause, "robot", "unknown"):
        weight = weight_role(clause.text)
        if weight is not None and not draft.of(clause, "network", "compute", "share"):
            _give(draft, at, weight, "place", "class")
    elif THERE.search(clause.text):
        weight = weight_role(clause.text)
        if weight == "high":
            _give(draft, at, weight, "place")
    if not clause.text.split() or not clause.mentions:
        return
    numbers = draft.of(clause, "place", "class")
    if numbers and all(draft.roles[n] is None for n in numbers) and at + 1 < len(draft.clauses):
        after = draft.clauses[at + 1]
        roles = {draft.roles[n] for n in draft.of(after, "place", "class")}
        bare = set(clause.text.split()) <= FILLERS and after.sentence == clause.sentence
        if bare and len(roles) == 1 and not draft.void[at + 1] and weight_role(after.text):
            draft.set(numbers, roles.pop())


def _pointed_role(draft: Draft, clause: Clause, *, pointed: bool) -> Role | None:
    """What a clause says of robots that are named beside it."""
    role = robot_role(clause.text, alone=True)
    robotless = not any(m.kind in ("robot", "unknown") for m in draft.text.mentions)
    asks = robots.UNUSED.search(clause.text) or unknown_thing(clause.text)
    first = robots.FIRST.search(clause.text) and asks
    at = draft.clauses.index(clause)
    before = draft.clauses[max(0, at - 2) : at]
    out = robots.OUT.search(clause.text) and not common.PRONOUN.search(clause.text)
    placed = any(draft.of(near, "place", "class") for near in before)
    weighs = weight_role(clause.text) is not None and not first and (placed or not out)
    told = role == "only" and not _ONLY_FIRST.match(clause.text)
    if robotless and (role == "doubt" or weighs or told):
        return None
    if role == "only" and clause.mentions and not pointed and fleet.SUFFICES.search(clause.text):
        return None  # "Until noon is enough": it is the time that suffices.
    others = fleet.OTHERS.search(clause.text) and not common.PRONOUN.search(clause.text)
    # It is the others who are out, or come first.
    others = others and not robots.OVER_OTHERS.search(clause.text)
    return "doubt" if role in ("first", "out") and others else role


def _slips(draft: Draft, at: int) -> bool:
    """ "Skip R3, they slip away": whether a clause tells more of robots that are out anyway."""
    clause, before = draft.clauses[at], draft.clauses[max(0, at - 1)]
    words = draft.text.words[clause.first : clause.last]
    if not _THEY.match(clause.text) or before.sentence != clause.sentence or len(words) < 2:
        return False
    noun = draft.text.wish[words[1].start].isupper()
    return not noun and {draft.roles[n] for n in draft.of(before, "robot")} == {"out"}


def _weighs_thing(draft: Draft, at: int, clause: Clause) -> bool:
    """Whether a clause tells how much a place or a class counts, of which the one before speaks."""
    if not _WEIGHS.search(clause.text) or weight_role(clause.text) is None:
        return False
    for near in range(at - 1, max(-1, at - 3), -1):
        before = draft.clauses[near]
        if any(draft.text.mentions[n].kind != "time" for n in before.mentions):
            things = draft.of(before, "place", "class")
            return bool(things) and not draft.of(before, "robot", "unknown")
    return False


def _moved(text: str) -> bool:
    """Whether a clause does something with the robots of which it speaks."""
    cues = (robots.OUT, robots.UNUSED, fleet.IDLE, fleet.BACKUP, robots.FIRST, common.NOT)
    plain = fleet.REST.sub(" ", text, count=1)
    return any(cue.search(plain) for cue in cues) or bool(_NO & {*plain.split()})


def _give(draft: Draft, at: int, role: Role, *kinds: str) -> bool:
    """Whether something of a kind was named near that has no other role."""
    for near in (*range(at - 1, max(-1, at - 4), -1), at + 1):
        if not 0 <= near < len(draft.clauses):
            continue
        clause = draft.clauses[near]
        numbers = draft.of(clause, *kinds)
        if not numbers:
            continue
        if any(draft.roles[n] not in (None, role) for n in numbers):
            return False
        backup = role == "first" and fleet.BACKUP.search(clause.text)
        if near > at and (backup or clause.sentence != draft.clauses[at].sentence):
            return False
        there = kinds == ("place",) and tells(draft.clauses, clause)
        pointed = there or common.PRONOUN.search(draft.clauses[at].text)
        if draft.void[near] and not (clause.asked or pointed):
            return False
        draft.set(numbers, role)
        return True
    return False
