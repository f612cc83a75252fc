"""Reads a wish by cue words alone, clause by clause: what the model says is held against this.

It reads what its words plainly say and doubts the rest; where nothing says anything, it says
`none`.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clashes import doubt_clashes
from llm_gateway.wishes.clauses.draft import STRONG, Draft
from llm_gateway.wishes.clauses.elliptic import read_elliptic
from llm_gateway.wishes.clauses.kept import kept
from llm_gateway.wishes.clauses.leftover import doubt_leftover, doubt_told
from llm_gateway.wishes.clauses.measured import measured
from llm_gateway.wishes.clauses.named import read_named
from llm_gateway.wishes.clauses.referred import read_referred
from llm_gateway.wishes.clauses.reported import idle, only_reasons, others_need
from llm_gateway.wishes.clauses.roles import asks, nobody
from llm_gateway.wishes.clauses.spans import doubt_spans
from llm_gateway.wishes.clauses.strangers import doubt_strangers
from llm_gateway.wishes.clauses.traps import doubt_traps
from llm_gateway.wishes.clauses.turned import stays
from llm_gateway.wishes.clauses.voids import foreign, reasons, supposes, tells
from llm_gateway.wishes.clauses.whole import read_whole
from llm_gateway.wishes.names.mentions import Text
from llm_gateway.wishes.reading import Reading, Role, Verdict


def read(text: Text) -> Reading:
    """The rules' reading of a wish; settle it (`account`) before anything is made of it."""
    if foreign(text):
        nothing = tuple[Role, ...]("none" for _ in text.mentions)
        return Reading(nothing, "nothing", (text.whole,), final=True)
    if (whole := read_whole(text)) is not None:
        return whole
    draft = Draft.of_text(text)
    for at, clause in enumerate(draft.clauses):
        if not draft.void[at] and nobody(clause.text):
            draft.nobody = True
            draft.handled.add(at)
        if not draft.void[at]:
            read_named(draft, at, clause)
        elif not (tells(draft.clauses, clause) or idle(draft, clause)) and (
            clause.mentions or STRONG.search(clause.text)
        ):
            draft.doubt(clause)
        if draft.void[at] and not clause.mentions and supposes(draft.clauses, clause):
            draft.supposed.append(clause)
    draft.handled |= {at for at in range(len(draft.clauses)) if others_need(draft, at)}
    for at, clause in enumerate(draft.clauses):
        if not draft.void[at] and at not in draft.handled and not reasons(clause):
            read_referred(draft, at, clause)
            doubt_leftover(draft, clause)
    read_elliptic(draft)
    _repeat(draft)
    doubt_strangers(draft)
    for clause in draft.clauses:
        if tells(draft.clauses, clause):
            doubt_told(draft, clause)
    _tell_times(draft)
    staying = kept(draft)
    draft.set(sorted(staying), "none")
    doubt_clashes(draft)
    doubt_spans(draft)
    doubt_traps(draft)
    roles = tuple[Role, ...](role or "none" for role in draft.roles)
    if draft.nobody and any(m.kind == "robot" for m in text.mentions):
        # Who is named beside it may be an exception.
        draft.nobody = False
        roles = tuple[Role, ...]("doubt" if role in ("only", "first") else role for role in roles)
        draft.firm.append(text.whole)
    wished = draft.nobody or any(role not in ("none", "doubt", "when") for role in roles)
    verdict: Verdict = "all" if wished else "nothing"
    unclear = tuple(dict.fromkeys([*draft.unclear, *draft.firm]))
    if wished and (unclear or "doubt" in roles):
        verdict = "part"
    suspected = tuple(draft.suspected.get(n) for n in range(len(roles)))
    return Reading(
        roles,
        verdict,
        unclear,
        tuple(dict.fromkeys(draft.firm)),
        suspected,
        only_reasons(draft) | staying,
        measured(draft),
        draft.nobody,
    )


_THEN = {"then", "dann", "da", "dahin"}
"""In a time they point to one that is told before."""
_BOUNDS = re.compile(
    r"\b(?:start|begin|stop|end|finish|wrap|clos|shut|over|done|leav|beginn|schluss|aufhoer|fertig|"
    r"vorbei|feierabend|los|knock|again|back|wieder)\w*"
)
"""Tells a beginning or an end."""


def _tell_times(draft: Draft) -> None:
    """ "Launch is at 3, so watch the docks until 4": beside a beginning or an end, a time that a
    clause names alone and that is neither is a report's."""
    whens = [mention.when for mention in draft.text.mentions if mention.when is not None]
    if not any(when.clear and (when.start or when.until) for when in whens):
        return
    days = {
        time.date() for when in whens if when.clear for time in (when.start, when.until) if time
    }
    for number, mention in enumerate(draft.text.mentions):
        if mention.when is not None and mention.when.day in days and draft.roles[number] == "doubt":
            draft.roles[number] = "none"  # "Today until five".
    words = draft.text.words
    pointed = any(
        mention.when is not None and words[mention.first + 1].text in _THEN
        for mention in draft.text.mentions
        if mention.last - mention.first > 1
    )
    for clause in draft.clauses:
        numbers = draft.of(clause, "time")
        lonely = len(clause.mentions) == 1 and not _BOUNDS.search(clause.text)
        if len(numbers) != 1 or not (lonely or pointed):
            continue
        number = numbers[0]
        mention = draft.text.mentions[number]
        loose = mention.when is not None and not mention.when.clear and not mention.when.question
        at = draft.text.words[mention.first].text in ("at", "um")
        if loose and at and draft.roles[number] == "doubt":
            draft.roles[number] = "none"


def _repeat(draft: Draft) -> None:
    """What is named twice has the role of where it has one; a short resource is to be saved."""
    mentions = draft.text.mentions
    asked = {n for c in draft.clauses if asks(c.text) for n in draft.of(c, "robot")}
    back = {n for c in draft.clauses if stays(c.text) for n in draft.of(c, "robot")}
    for number, mention in enumerate(mentions):
        if draft.roles[number] is not None:
            continue
        short = number in draft.wasted
        others = [
            (role, set(other.names))
            for role, other in zip(draft.roles, mentions, strict=True)
            if role is not None and other.kind == mention.kind
        ]
        names = set(mention.names)
        roles = {role for role, same in others if short or names & same}
        covered = short or (names and names <= set().union(*(same for _, same in others)))
        if roles == {"out"} and number in back:
            draft.roles[number] = "doubt"  # "Skip R1 and R2, but keep R2".
            continue
        if roles == {"out"} and number in asked:
            continue  # "Skip R1. R1 must be asked".
        if len(roles) == 1 and covered and (number not in draft.doubted or "out" in roles):
            draft.roles[number] = roles.pop()
    for number in (*draft.wasted, *draft.doubted):
        draft.roles[number] = draft.roles[number] or "doubt"
