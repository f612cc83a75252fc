"""Asks back about what clauses of a wish say of things that nobody knows."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import STRONG, THERE, Draft
from llm_gateway.wishes.clauses.negations import negated
from llm_gateway.wishes.clauses.roles import nobody, robot_role
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import fleet, robots
from llm_gateway.wishes.cues.plain import strange, unknown_robots, unknown_thing
from llm_gateway.wishes.names import lexicon

_ARTICLE = re.compile(
    r"^(?:(?:not|nicht) (?:auf )?(?=the|d[aei]))?(?:the|a|an|den|die|das|dem|der|on the|at the|"
    r"auf die|zum|zur)(?: [a-z]+){1,2}$"
)
_ACTS = re.compile(
    r"^(?:\w+ ){0,2}(?:turn|bump|dial|weigh|leave|skip|ignore|exclude|lass\w*|ask|use|fragt?|"
    r"nimm|nehmt|gewicht\w*|spart? aus)\b|(?<!- )(?<!ing )\b(?:up|down|high|low|hoch|runter)$"
)
"""Does something to what it names."""
_CLOSING = re.compile(r"(?:gruess\w*|regards|cheers|lg|mfg|vg)$")
"""Behind it stands who writes."""
_TOO = re.compile(r"(?:and |und )?([a-z]{4,}) (?:too|also|auch|as well)")
_ABOVE_ALL = re.compile(r"\b(?:above|after|at|first of|in|of|over|vor) all(?:em|en)?\b")
_LOOKS = re.compile(
    r"\b(?:(?:genau|genauer|gut|scharf) (?:gucken|schauen|sehen)|hin(?:guck|schau|seh)\w*|"
    r"look (?:\w+ )?(?:close|hard|sharp)\w*|look out|rank|rate|take care)\b"
)
"""Wishes that one looks, at whatever it is."""
_WHOM = re.compile(
    r"\b(?:(?:any|every|no|some)(?:body|one)|no one|niemand\w*|keine[nr]?|ones|those|whichever|"
    r"who(?:ever|m|mever)?|wen|wer)\b"
)
"""Speaks of robots by no name."""
_ITS_EYES = re.compile(r"\b(?:her|his|ihre|ihren|its|seine|seinen) (?:\w+ )?(?:augen?|eyes?)\b")
"""A robot's own."""
_POLICY = re.compile(r"\b(?:policy|strategy|strategie)\b")
_KEPT = re.compile(
    r"\b(?:keep|leave) (?:the|our) (?:current |same )?(?:policy|strategy)(?: as (?:it )?is)?$|"
    r"\b(?:policy|strategie|strategy) (?:as before|bleibt(?: (?:gleich|so|wie (?:gehabt|"
    r"sie ist)))?|stays(?: (?:as (?:it )?is|the same))?|unchanged|wie gehabt)$"
)
"""Lets the policy be as it is."""
_FORBIDS = re.compile(
    r"\b(?:nobody|no ?one|none|niemand|keiner) (?:darf|is (?:allowed|permitted|to)|may|must|shall|"
    r"should|soll\w*)\b|\b(?:darf|soll\w*)(?: \w+){0,3} (?:keiner|niemand)\b"
)
"""Forbids something, of robots or of people."""
_OTHERS = re.compile(
    r"\b(?:others?|rest|anderen|uebrigen|fahren|gehen|haben|hatten|helfen|kommen|laufen|machen|"
    r"stehen|warten|ist|sind|waere?s?|sofort|darf|kann|muss|soll|will|same|needs|wants|has|runs|comes)$|t$"
)
"""Ends what begins like an article and is none, or names nothing that a site has."""


def doubt_leftover(draft: Draft, clause: Clause) -> None:
    """Doubts what a clause wishes of something that nobody knows."""
    at = draft.clauses.index(clause)
    writes = at and _CLOSING.search(draft.clauses[at - 1].text)
    if at in draft.handled or writes:
        return
    named = draft.of(clause, "robot", "place", "class", "unknown", "policy")
    lonely = not named and not draft.of(clause, "network", "compute", "share")
    if _is_stranger(clause) or (lonely and _wishes_unread(draft, clause)):
        draft.doubt(clause)


def _wishes_unread(draft: Draft, clause: Clause) -> bool:
    """Whether a clause that names nothing wishes something all the same."""
    text = clause.text
    acts = robots.OUT.search(text) or robots.UNUSED.search(text) or robots.ONLY.search(text)
    if (
        set(_ABOVE_ALL.sub(" ", text).split()) & lexicon.EVERYBODY
        and "out" not in draft.roles
        and acts
    ):
        return True
    if (STRONG.search(_ITS_EYES.sub(" ", text)) or _LOOKS.search(text)) and not THERE.search(text):
        return not _bound(draft, clause) or unknown_thing(text)
    if (_ACTS.search(text) or weight_role(text)) and unknown_thing(text):
        return True
    hard = robots.OUT.search(text) or robots.ONLY.search(text) or (acts and negated(text))
    if hard and "only" not in draft.roles and _WHOM.search(text) and not _bound(draft, clause):
        return True
    if _TOO.fullmatch(text) and strange(text):
        return True
    forbids = _FORBIDS.search(text) and not {"else", "sonst"} & {*text.split()}
    if (forbids or fleet.NOBODY.search(text)) and not nobody(text):
        return True
    if {*text.split()} & lexicon.ROBOT_WORDS and (negated(text) or acts) and unknown_robots(text):
        return True
    kept = _KEPT.search(text) and not negated(text)
    return "policy" not in draft.roles and not kept and bool(_POLICY.search(text))


def _bound(draft: Draft, clause: Clause) -> bool:
    """Whether what a clause says went to something beside it."""
    at = draft.clauses.index(clause)
    role = weight_role(clause.text) or robot_role(clause.text, alone=True)
    near = draft.clauses[max(0, at - 2) : at + 2]
    return any(draft.roles[n] == role for c in near for n in draft.of(c, "place", "class", "robot"))


def doubt_told(draft: Draft, clause: Clause) -> None:
    """Doubts a report that names what no wish beside it is about."""
    named = draft.of(clause, "robot", "place", "class", "share", "policy", "unknown")
    settled = draft.of(clause, "policy") if "policy" in draft.roles else []
    draft.set([n for n in settled if draft.roles[n] is None], "none")
    lost = any(draft.roles[n] in (None, "doubt") for n in named)
    if lost or (not named and STRONG.search(clause.text)):
        draft.doubt(clause)


def _is_stranger(clause: Clause) -> bool:
    """Whether a clause is but something that nobody knows: "the cafeteria"."""
    if clause.mentions or not _ARTICLE.match(clause.text):
        return False
    return not (_OTHERS.search(clause.text) or re.match(r"(?:das|der|die) \w+ ", clause.text))
