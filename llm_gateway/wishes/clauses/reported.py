"""Tells which places and classes a wish names only to give its reason: "because people are out
there", "it is charging at the docks"."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import STRONG, Draft
from llm_gateway.wishes.clauses.negations import negated
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import asides, robots
from llm_gateway.wishes.cues.asides import STATES
from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.words import text_at

_IS = re.compile(r"\bCLASS (?:is|are|ist|sind|s)\b|\bCLASS (?:\w+ )*(?:ist|sind)$")
_STORY = re.compile(
    r"(?:an?|eine?|irgendein|one|so ein|some) CLASS\b(?!.*\b(?:are|is|ist|sind)\b)"
    r"(?=.*\b(?:almost|beinahe|fast|fell|got|had|hat|nearly|ran|[a-z]{3,}ed)\b)"
)
"""Tells what one of a class did: "some bloke on a bike nearly fell"."""
_COLLEAGUES = ("colleague", "folk", "guys", "kolleg", "lads", "staff")
_BUSY = re.compile(
    r"(?:(?:the|die|our|unsere) )?CLASS(?: (?:aus|from|in|of|vom|von)(?: (?:der|the))? \w+)?"
    r"(?: [a-zA-Z]+){2,}"
)
"""Tells what colleagues do."""
_WE_DO = re.compile(
    r"(?:(?:as|because|da|denn|since|weil) )?(?:jemand|man|some(?:body|one)|they|theyre|we|were|"
    r"weve|wir)\b(?!.*\b(?:brauch\w*|care|expect|like|love|moecht\w*|must|need|prefer|should|soll\w*|"
    r"think|want|wish|woll\w*)\b)(?: (?:also|are|currently|gerade|heute|is|just|nearly|now|still))*"
    r" (?:clean|deliver|entlad|hit|install|lad|liefer|load|montier|mov(?:e|ing)|pack|reinig|"
    r"repair|reparier|ship|transport|unload|verlad|verleg|verschieb)\w*"
    r"(?: (?!(?:in|nur|on|only)\b)[a-z0-9]+){0,2} CLASS\b"
)
"""Tells what those who wish are doing with a class: "we're moving patients"."""
_ASIDE = {"(", "-", "–", "—"}
_WHILE = re.compile(
    r"\b(?:THEN|(?:as|so) (?:long|soon) as|bis|once|sobald|solange|till|unless|until|waehrend|"
    r"when\w*|"
    r"while)\b"
)
"""Makes a condition of what a clause tells."""
_THEREFORE = {"also", "damit", "so"}
_ACTS = (robots.OUT, robots.ONLY, robots.FIRST, robots.POSSIBLY)
_AILS = re.compile(
    r"(?:(?:der|die|das|the) )*ROBOT (?:charges|hakt|klemmt|laden|laedt|spinnt|streikt|"
    r"(?:are|haengt|is|ist|sind)(?: (?:at|am|an der|currently|gerade|just|noch|now|still))*"
    r" (?:beschaeftigt|broken|busy|charging|damaged|defective|defekt|faulty|kaputt|krank|laden|"
    r"ladestation|stuck))(?: (?:anyway|at|gerade|jetzt|now|sowieso|PLACE|the))*"
)
"""Tells what is wrong with robots, and nothing else."""
_NEEDS_IT = re.compile(r"\b(?:brauch\w*|needs?) .*\b(?:CPU|NET)\b")
_WE_ARE = re.compile(
    r"(?:(?:and|as|because|da|denn|und|weil) )*(?:i am|im (?=[a-z]+ing\b)|ich bin|jemand|man|"
    r"some(?:body|one)|we are|were|wir sind)\b"
)
"""Tells what those who wish do, and may look for."""
_THEY_ARE = re.compile(
    r"(?:(?:and|as|because|da|denn|und|weil) )*(?:er|he|hes|it|its|sie|she|shes|they|theyre)\b"
)
"""Tells what robots, which were named before, are for."""
_THERE = re.compile(r"\b(?:dort|here|hier|there|where)\b")
_IT_IS = re.compile(
    r"^(?:(?:and|as|because|beide|both|da|denn|der|die|er|he|it|she|sie|that|they|und|weil|"
    r"ROBOT) )*(?:are|charges|fahren|faehrt|haeng(?:t|en)|hes|is|ist|its|laden|laedt|parkt?s?|"
    r"shes|sind|sits?|stands?|steck(?:t|en)|steh(?:t|en)|theyre)(?: (?:busy|charging|currently|"
    r"gerade|jetzt|just|noch|now|over|parked|right|sitting|standing|still|stood|stuck|waiting|"
    r"working|(?:bringing|carrying|fetching|hauling|moving) [a-z]+))* (?:am|an|at|auf|bei|beim|by|"
    r"from|im|in|near|next to|on)(?: (?:a|dem|den|der|einer?|einem|our|the)(?: [a-z]+ (?:am|an|at|"
    r"auf|bei|beim|by|im|in|near|on)(?: (?:dem|den|der|our|the))?)?)? PLACE\b"
)
"""Tells where robots are, which were named before, and not how well they do there."""
_ANYWAY = re.compile(r"(?: (?:already|anyway|gerade|jetzt|now|right|schon|sowieso|TIME))*")
"""May stand behind a place where robots are that are asked."""
_IS_FINE = re.compile(
    r"^(?:(?:am|an|at|auf|bei|beim|das|dem|den|der|die|hi|im|in|moin|on|the) )*PLACE "
    r"(?:is running|laeuft|laufen|passt|runs|(?:is|ist) (?:alright|fine|gut|"
    r"in ordnung|ok|okay))\b"
)
"""Tells that a place may stay as it is."""


def only_reasons(draft: Draft) -> frozenset[int]:
    """The numbers of places and classes of which nothing is wished."""
    found: set[int] = set()
    for at, clause in enumerate(draft.clauses):
        if draft.void[at] and idle(draft, clause):
            found |= {*draft.of(clause, "share")}
        if asides.LOADED.search(clause.text) and not _supposed(clause):
            found |= {n for n in draft.of(clause, "share") if draft.roles[n] == "none"}
        if whereabouts(draft, at) or _is_fine(draft, at) or _states(draft, clause):
            named = draft.of(clause, "class", "place")
            found |= {n for n in named if draft.roles[n] in (None, "none")}
        if "only" in draft.roles and _ails(draft, clause):
            found |= {n for n in draft.of(clause, "robot") if draft.roles[n] in (None, "none")}
        numbers = [n for n in draft.of(clause, "class") if draft.roles[n] in (None, "none")]
        told = (
            _STORY.match(clause.text)
            or _colleagues(draft, clause)
            or _tells(draft, clause)
            or _we_do(draft, at)
            or _named_for(draft, clause)
        )
        if numbers and weight_role(clause.text) is None and told:
            found |= {*numbers}
    return frozenset(found)


def whereabouts(draft: Draft, at: int) -> bool:
    """ "R3 out, it's at the docks": whether a clause only tells where robots are of which the one
    before it wishes something."""
    clause, before = draft.clauses[at], draft.clauses[max(0, at - 1)]
    wished = {draft.roles[n] for n in draft.of(before, "robot")} & {"first", "only", "out"}
    own = {draft.roles[n] for n in draft.of(clause, "robot")}
    if not (own == {"out"} or (at and wished and not own)) or _supposed(clause):
        return False
    stands = _IT_IS.search(clause.text)
    if stands is None or STRONG.search(clause.text):
        return False
    return "out" in wished | own or bool(_ANYWAY.fullmatch(clause.text[stands.end() :]))


def _supposed(clause: Clause) -> bool:
    return clause.opener == "while" or bool(_WHILE.search(clause.text))


def others_need(draft: Draft, at: int) -> bool:
    """ "At most half the link, the monitors come first": whether a clause only tells what else the
    link is for."""
    clause, near = draft.clauses[at], draft.clauses[max(0, at - 1) : at + 2]
    roles = {draft.roles[n] for c in near for n in c.mentions}
    parted = not roles.isdisjoint({"free", "link", "save"})
    return parted and not clause.mentions and bool(asides.USERS.match(clause.text))


def _ails(draft: Draft, clause: Clause) -> bool:
    """ "R2 is charging, ask only R4": whether a clause only tells what is wrong with robots."""
    held = [n for n in clause.mentions if draft.roles[n] not in (None, "none", "when")]
    acts = negated(clause.text) or any(cue.search(clause.text) for cue in _ACTS)
    return bool(_AILS.fullmatch(clause.text)) and not (held or acts or clause.asked)


def _states(draft: Draft, clause: Clause) -> bool:
    """ "The people in hall 3 complain, save bandwidth": whether a clause only tells how things are,
    in a wish in which no place and no class counts more or less."""
    tells = STATES.search(clause.text) or _NEEDS_IT.search(clause.text)
    if not tells or clause.asked or negated(clause.text) or _supposed(clause):
        return False
    asked = {"first", "only", "out"} & {*draft.roles}
    if _WE_ARE.match(clause.text) or (asked and _THEY_ARE.match(clause.text)):
        return False
    others = [c for c in draft.clauses if c is not clause]
    weighs = {"doubt", "high", "low"} & {*draft.roles} or any(
        (weight_role(c.text) and not draft.of(c, "compute", "network", "robot"))
        or (c is not clause and _THERE.search(c.text))
        for c in draft.clauses
    )
    acts = any(cue.search(clause.text) for cue in _ACTS)
    wished = {draft.roles[n] for c in others for n in c.mentions} - {None, "none", "when"}
    return bool(wished) and not (weighs or acts)


def _is_fine(draft: Draft, at: int) -> bool:
    """ "Hall 3 is fine, the docks matter": whether a place may stay as it is, beside a wish."""
    clause = draft.clauses[at]
    if (
        _supposed(clause)
        or not _IS_FINE.match(clause.text)
        or weight_role(clause.text)
        or negated(clause.text)
    ):
        return False
    others = [c for c in draft.clauses if c is not clause]
    return any(draft.roles[n] not in (None, "none", "when") for c in others for n in c.mentions)


def _colleagues(draft: Draft, clause: Clause) -> bool:
    """ "die Kollegen vom Service machen ein Update": whether colleagues only are at work."""
    firsts = [draft.text.mentions[n].first for n in draft.of(clause, "class")]
    said = [draft.text.words[first].text for first in firsts]
    acts = robots.OUT.search(clause.text) or negated(clause.text)
    return bool(_BUSY.fullmatch(clause.text)) and said[0].startswith(_COLLEAGUES) and not acts


def _we_do(draft: Draft, at: int) -> bool:
    """ "Beds matter most, we're moving patients": whether a class only is what one works at."""
    clause = draft.clauses[at]
    if not _WE_DO.match(clause.text) or negated(clause.text):
        return False
    before = [c for c in draft.clauses[:at] if c.sentence == clause.sentence]
    wished = any(draft.roles[n] not in (None, "none", "when") for c in before for n in c.mentions)
    after = draft.clauses[at + 1] if at + 1 < len(draft.clauses) else None
    return wished or (after is not None and after.opener in _THEREFORE)


def _named_for(draft: Draft, clause: Clause) -> bool:
    """ "- patient transfers": whether a class only tells of what kind something is."""
    numbers = draft.of(clause, "class")
    if clause.opener not in _ASIDE or len(numbers) != 1 or len(clause.mentions) != 1:
        return False
    behind = text_at(draft.text.words, draft.text.mentions[numbers[0]].last)
    return clause.text.startswith("CLASS ") and behind.isalpha() and not known(behind)


def idle(draft: Draft, clause: Clause) -> bool:
    """Whether a clause wishes nothing, and names nothing that a wish beside it does not name:
    "a box won't cry if you bump it, so boxes: low"."""
    mentions = draft.text.mentions
    if (shares := draft.of(clause, "share")) and {*clause.mentions} <= {
        *shares,
        *draft.of(clause, "network"),
    }:
        return all(_bound_again(draft, clause, n) for n in shares)
    if len(draft.of(clause, "place", "class")) != len(clause.mentions) or not clause.mentions:
        return False
    again = {
        name
        for other, void in zip(draft.clauses, draft.void, strict=True)
        for n in (() if void else draft.of(other, "place", "class"))
        for name in mentions[n].names
    }
    named = {name for n in clause.mentions for name in mentions[n].names}
    return named <= again and not STRONG.search(clause.text) and weight_role(clause.text) is None


def _bound_again(draft: Draft, clause: Clause, number: int) -> bool:
    """ "It jams as soon as we go over 40 %, so 40 % of the link": whether a part is drawn from the
    same one in the clause before it."""
    at = draft.clauses.index(clause) + 1
    after = draft.clauses[at] if at < len(draft.clauses) else None
    share = draft.text.mentions[number].share
    if after is None or after.opener not in _THEREFORE or share is None:
        return False
    drawn = (draft.text.mentions[n].share for n in draft.of(after, "share"))
    return any(other is not None and other.value == share.value for other in drawn)


def _tells(draft: Draft, clause: Clause) -> bool:
    """Whether a clause is but the reason of another one that wishes something."""
    if not _IS.search(clause.text):
        return False
    others = [c for c in draft.clauses if c is not clause and c.sentence == clause.sentence]
    wished = [n for c in others for n in c.mentions if draft.roles[n] not in (None, "none")]
    if clause.opener in asides.REASONS:
        return bool(wished)
    places = {name for n in draft.of(clause, "place") for name in draft.text.mentions[n].names}
    again = {name for n in wished for name in draft.text.mentions[n].names}
    return bool(places & again)
