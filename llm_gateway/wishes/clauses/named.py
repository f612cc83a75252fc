"""What each clause of a wish says of what it names itself."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.clause import Clause
from llm_gateway.wishes.clauses.draft import FILLERS, Draft
from llm_gateway.wishes.clauses.negations import denies, needless, negated
from llm_gateway.wishes.clauses.parts import read_parts
from llm_gateway.wishes.clauses.policies import read_policies
from llm_gateway.wishes.clauses.reported import whereabouts
from llm_gateway.wishes.clauses.roles import certain, robot_role
from llm_gateway.wishes.clauses.turned import stays
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import common, resources, robots, speech
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.reading import Role
from llm_gateway.wishes.words import Word

_TOO = frozenset({"ROBOT", "too", "also", "auch", "ebenfalls", "likewise", "ebenso", "TIME"})
_NO_NO = re.compile(r"no ROBOT(?: no ROBOT)+(?: TIME)?(?: please)?")
_NAMES = re.compile(r"\b(?:ROBOT|PLACE|CLASS|SHARE|POLICY|UNKNOWN)\b")
NEITHER = re.compile(
    r"\b(?:auch (?:nicht|nich|ned|net|nid)|(?:also|too) no[tr]?|not also|either|neither|nor)\b"
)
_SAME = re.compile(
    r"(?:the )?same (?:goes |thing |holds |applies )?(?:for|with|to) ROBOT(?: too)?|"
    r"(?:das|da)?(?:selbe|gleiche)s? (?:gilt )?(?:auch )?(?:fuer|mit) (?:(?:den|die|das) )?ROBOT|"
    r"(?:genauso|ebenso) (?:(?:der|die|das|den) )?ROBOT"
)
_ALSO = re.compile(r"\b(?:also|too|auch|ebenfalls|ebenso|likewise|as well)\b")
_NOT_THIS = re.compile(
    r"(?:not|nicht)(?: (?:den|der|die|das|the))? ROBOT(?: (?:bitte|please|TIME))*"
)
_NOBODY = re.compile(r"\b(?:keiner|niemand|no ?one|nobody)\b")
_SAVE_FOR = re.compile(
    r"(?:aber|allein|alone|bloss|apart|aside|ausgenommen|ausser|barring|besides|bis auf|but|"
    r"except\w*|just|mit ausnahme|nur|only|other than|save|sondern|unless|with the exception)\b|"
    r"(?:(?:das|den|der|die|the) )?ROBOT (?:ausgenommen|except\w*|exclud\w*|schon)\b"
)
"""Behind "nobody may ask R2" they begin to tell who may, or may not be asked either."""
_BARE = re.compile(
    r"(?:(?:den|der|die|das|the|just|bitte|please) )*ROBOT(?: (?:bitte|instead|please|TIME))*"
)
_SINCE = {"seit", "since"}
"""Before a time they tell how long something is so already."""


def read_named(draft: Draft, at: int, clause: Clause) -> None:
    """Gives roles to what clause number `at` names, as far as its own words say them."""
    _robots(draft, at, clause)
    _weights(draft, at, clause)
    read_parts(draft, at, clause)
    _resources(draft, clause)
    read_policies(draft, clause)
    _others(draft, clause)


def _robots(draft: Draft, at: int, clause: Clause) -> None:
    numbers = draft.of(clause, "robot")
    if not numbers:
        return
    rather = robots.RATHER.search(clause.text) and not robots.OUT.search(clause.text)
    if len(numbers) == 2 and rather:
        draft.set(numbers[:1], "first")
        return
    if _NO_NO.fullmatch(clause.text):
        draft.set(numbers, "out")
        return
    role = robot_role(clause.text)
    if role is None and at and robots.NEXT.fullmatch(clause.text):
        before = {draft.roles[n] for n in draft.of(draft.clauses[at - 1], "robot")}
        role = "first" if before == {"first"} else None
    same = set(clause.text.split()) <= _TOO or _SAME.fullmatch(clause.text)
    if role is None and at and same:
        near = draft.clauses[max(0, at - 3) : at] if _SAME.fullmatch(clause.text) else []
        named = [draft.of(c, "robot") for c in near or draft.clauses[at - 1 : at]]
        before = {draft.roles[n] for n in next((n for n in reversed(named) if n), [])}
        role = before.pop() if len(before) == 1 else None
        after = draft.clauses[at - 1]
        if not named[-1] and clause.opener in ("and", "und") and common.PRONOUN.search(after.text):
            # "Skip him and R3".
            role = robot_role(after.text, alone=True)
    if role in ("out", "only") and not certain(clause.text, role):
        # What is said plainly of "it" beside this may still leave it out.
        draft.doubted += numbers
        if len(numbers) == 1:
            draft.suspected[numbers[0]] = role
        role = None if role == "out" else "doubt"
    if role == "out" and at and (_NOT_THIS.fullmatch(clause.text) or stays(clause.text)):
        # "Skip R2, but not R3".
        before = {draft.roles[n] for n in draft.of(draft.clauses[at - 1], "robot")}
        skipped = before == {"out"} and not negated(draft.clauses[at - 1].text)
        role = "doubt" if skipped else role
    listed = {word.text for n in numbers for word in _words(draft, n)}
    said_no = any(negated(c.text) for c in draft.clauses if c.sentence == clause.sentence)
    if role in ("only", "out") and listed & {"or", "oder"} and not said_no:
        role = "doubt"  # "Skip R2 or R3".
    if _crosses(draft, at, clause):
        draft.crossed |= {at, at + 1}
    if at and re.fullmatch(r"(?:not|nicht) ROBOT", clause.text):
        named_first = draft.clauses[at - 1]
        if named_first.text == "ROBOT" and named_first.sentence == clause.sentence:
            # "R2, not R3, stays out".
            draft.crossed.add(at)
    if role is not None and (len(numbers) > 1 or at in draft.crossed):
        role = "doubt"
    draft.set(numbers, role)


def _words(draft: Draft, number: int) -> tuple[Word, ...]:
    """The words with which something is named."""
    mention = draft.text.mentions[number]
    return draft.text.words[mention.first : mention.last]


def _crosses(draft: Draft, at: int, clause: Clause) -> bool:
    """Whether "not R3 but R4 should be left out", "don't ask R3 but R4", or "nobody may ask R3 but
    R4" begins here: no cue tells who is out."""
    after = draft.clauses[at + 1] if at + 1 < len(draft.clauses) else None
    if after is None or not draft.of(after, "robot"):
        return False
    if after.sentence != clause.sentence and after.opener not in ("aber", "but"):
        return False
    said = " ".join(word.text for word in draft.text.words[clause.first : clause.last])
    by_nobody = _NOBODY.search(said) and "NOBODYBUT" not in clause.text
    bare = _BARE.fullmatch(after.text)
    saved = bare or _SAVE_FOR.match(f"{after.opener} {after.text}".strip(" ,-–—()"))
    if by_nobody and saved:
        return True
    no = (bare and negated(clause.text)) or re.search(r"\b(?:not|nicht) ROBOT$", clause.text)
    return after.opener in ("aber", "but", "sondern") and bool(no)


def _weights(draft: Draft, at: int, clause: Clause) -> None:
    numbers = draft.of(clause, "place", "class")
    if not numbers:
        return
    if (len(numbers) > 1 and _each_weight(draft, clause, numbers)) or whereabouts(draft, at):
        return
    role = weight_role(clause.text)
    near = _nearest(draft, at)
    if near is not None and near.sentence != clause.sentence and not _ALSO.search(clause.text):
        near = None
    if role is None and near is not None:
        role = _inherited(draft, clause, near)
    draft.set(numbers, role)


def _nearest(draft: Draft, at: int) -> Clause | None:
    """The clause before it, or behind a clause that names nothing the one that names something."""
    for near in range(at - 1, max(-1, at - 4), -1):
        if draft.clauses[near].mentions or near == 0:
            return draft.clauses[near]
    return None


def _each_weight(draft: Draft, clause: Clause, numbers: list[int]) -> bool:
    """ "pallets less people more": whether each thing has a cue of its own behind it."""
    _, *pieces = re.split(r"\b(?:PLACE|CLASS)\b", clause.text)
    roles = [weight_role(f"CLASS {piece}") if piece.strip() else None for piece in pieces]
    if len(roles) != len(numbers) or set(roles) != {"high", "low"}:
        return False
    for number, role in zip(numbers, roles, strict=True):
        draft.roles[number] = role
    return True


def _inherited(draft: Draft, clause: Clause, before: Clause) -> Role | None:
    """The role that a clause without a cue takes from the one before it, or its opposite."""
    roles = {draft.roles[n] for n in draft.of(before, "place", "class")}
    if draft.of(clause, "robot") or len(roles) != 1:
        return None
    role = roles.pop()
    if role not in ("high", "low"):
        return None
    bare = set(clause.text.split()) <= FILLERS
    if clause.opener in ("but", "aber", "sondern") and not denies(clause.text):
        return None
    other: Role = "low" if role == "high" else "high"
    if denies(clause.text):
        same = NEITHER.search(clause.text) and role == "low"
        return (role if same else other) if bare else None
    if re.search(
        r"(?:PLACE|CLASS) (?:\w+ ){0,2}(?:do|does|can|are|is|schon|doch|very much)$", clause.text
    ):
        return other if denies(before.text) else role
    return role if bare else None


def _resources(draft: Draft, clause: Clause) -> None:
    numbers = draft.of(clause, "network", "compute")
    if not numbers:
        return
    role: Role | None = None
    if any(draft.roles[n] != "none" for n in draft.of(clause, "share")):
        role = "none"
    elif resources.WASTE.search(clause.text):
        stopped = negated(clause.text) or resources.STOP.search(clause.text)
        role = "save" if stopped else None
        if role is None:
            draft.wasted += numbers
    elif resources.SAVE.search(clause.text):
        role = "doubt" if negated(clause.text) or needless(clause.text) else "save"
    elif negated(clause.text) and resources.AT_MOST.search(clause.text):
        role = "doubt"
    draft.set(numbers, role)


def _others(draft: Draft, clause: Clause) -> None:
    for number in clause.mentions:
        mention = draft.text.mentions[number]
        if mention.kind == "time":
            idle = all(draft.roles[n] in (None, "none") for n in clause.mentions)
            since = _words(draft, number)[0].text in _SINCE or speech.HAPPENED.search(clause.text)
            draft.roles[number] = _time_role(mention, clause.text, told=idle and bool(since))
        elif mention.kind == "unknown":
            draft.roles[number] = "doubt"


def _time_role(mention: Mention, clause: str, *, told: bool) -> Role:
    """A time that is over belongs to the report that names it, and is unclear elsewhere. `told`:
    the clause only tells what happened then."""
    if mention.when is None or mention.when.clear:
        return "doubt" if mention.when is None else "when"
    over = mention.when.past and (speech.TOLD.search(clause) or not _NAMES.search(clause))
    return "none" if over or (told and not mention.when.question) else "doubt"
