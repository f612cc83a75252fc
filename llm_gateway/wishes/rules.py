"""Reads a wish by cue words alone, clause by clause: what the model says is held against this.

It reads what its words plainly say and doubts the rest; where nothing says anything, it says
`none`.
"""

from __future__ import annotations

import re

from llm_gateway.wishes import lexicon
from llm_gateway.wishes.clauses import Clause, clauses
from llm_gateway.wishes.cues import common, resources, robots, speech
from llm_gateway.wishes.mention import Mention
from llm_gateway.wishes.mentions import Text
from llm_gateway.wishes.plain import strange
from llm_gateway.wishes.reading import Reading, Role, Verdict
from llm_gateway.wishes.roles import (
    certain,
    negated,
    others_role,
    robot_role,
    share_role,
    weight_role,
)
from llm_gateway.wishes.voids import foreign, tells, void

_STRONG = re.compile(
    r"\b(?:watch|eyes?|focus\w*|attention|matters?|important|concentrate|monitor|achte|auge|"
    r"wichtig\w*|aufpassen|pass auf|keep an eye|look after|ignor\w*|prefer\w*|priority)\b"
)
"""Cues that are never mere talk."""
_ARTICLE = re.compile(
    r"^(?:the|a|an|den|die|das|dem|der|on the|at the|auf die|zum|zur)(?: [a-z]+){1,2}$"
)
_TOO = frozenset({"ROBOT", "too", "also", "auch", "ebenfalls", "likewise", "ebenso", "TIME"})
_OTHERS = re.compile(r"\b(?:others?|rest|anderen|uebrigen|ist|sind|waers?|sofort|same)$|t$")
"""Ends what begins like an article and is none, or names nothing that a site has."""
_OF_IT = re.compile(r"\b(?:of it|of that|davon)\b")
_THERE = re.compile(r"\b(?:where|wo|there|da|dort|here|hier|it|them|dort|daran|darauf|drauf)\b")
_FILLERS = frozenset(
    """please bitte danke thanks thx though halt mal eher rather dont doesnt wont arent much so
    wirklich really PLACE CLASS TIME the die den der das dem also auch nicht not too near at bei
    in im on an am a around beim about is are do does ist sind auf of especially besonders cant
    cannot isnt arent ned by um""".split()  # noqa: SIM905
)
"""Words beside which something named has the role of the clause before it."""


class Rules:
    """Reads one wish."""

    def __init__(self, text: Text) -> None:
        self._text = text
        self._clauses = clauses(text)
        self._roles: list[Role | None] = [None] * len(text.mentions)
        self._unclear: list[str] = []
        self._doubted: list[int] = []
        """Robots that may be out, by words that are not plain."""
        self._wasted: list[int] = []
        """Resources of which a report says that they are short."""
        self._handled: set[int] = set()
        self._crossed: set[int] = set()
        """Clauses that go on with the opposite of the one before, and share its verb."""
        self._void = [void(text, self._clauses, clause) for clause in self._clauses]

    def read(self) -> Reading:
        """The roles, and what stays unclear."""
        if foreign(self._text):
            return Reading(
                tuple(_or_none(None) for _ in self._roles), "nothing", (self._text.wish.strip(),)
            )
        for at, clause in enumerate(self._clauses):
            if self._void[at]:
                if not tells(self._clauses, clause) and (
                    clause.mentions or _STRONG.search(clause.text)
                ):
                    self._doubt(clause)
                continue
            self._robots(at, clause)
            self._weights(at, clause)
            self._shares(at, clause)
            self._resources(at, clause)
            self._others(clause)
        for at, clause in enumerate(self._clauses):
            if not self._void[at]:
                self._bind(at, clause)
                self._leftover(clause)
        self._repeated()
        for clause in self._clauses:
            if tells(self._clauses, clause):
                self._told(clause)
        roles = tuple(_or_none(role) for role in self._roles)
        wished = any(role not in ("none", "doubt", "when") for role in roles)
        verdict: Verdict = "all" if wished else "nothing"
        if wished and (self._unclear or "doubt" in roles):
            verdict = "part"
        return Reading(roles, verdict, tuple(dict.fromkeys(self._unclear)))

    def _repeated(self) -> None:
        """What is named twice has the role of where it has one; a short resource is to be saved."""
        mentions = self._text.mentions
        for number, mention in enumerate(mentions):
            if self._roles[number] is not None:
                continue
            short = number in self._wasted
            others = [
                (role, set(other.names))
                for role, other in zip(self._roles, mentions, strict=True)
                if role is not None and other.kind == mention.kind
            ]
            names = set(mention.names)
            roles = {role for role, same in others if short or names & same}
            covered = short or (names and names <= set().union(*(same for _, same in others)))
            if len(roles) == 1 and covered and (number not in self._doubted or "out" in roles):
                self._roles[number] = roles.pop()
        for number in (*self._wasted, *self._doubted):
            self._roles[number] = self._roles[number] or "doubt"

    def _told(self, clause: Clause) -> None:
        """Doubts a report that names what no wish beside it is about."""
        named = self._of(clause, "robot", "place", "class", "share", "policy", "unknown")
        lost = any(self._roles[n] in (None, "doubt") for n in named)
        if lost or (not named and _STRONG.search(clause.text)):
            self._doubt(clause)

    def _doubt(self, clause: Clause) -> None:
        said = self._text.said(clause.first, clause.last).strip(" ,")
        if said:
            self._unclear.append(said)

    def _of(self, clause: Clause, *kinds: str) -> list[int]:
        return [n for n in clause.mentions if self._text.mentions[n].kind in kinds]

    def _set(self, numbers: list[int], role: Role | None) -> None:
        for number in numbers:
            self._roles[number] = role

    def _robots(self, at: int, clause: Clause) -> None:
        numbers = self._of(clause, "robot")
        if not numbers:
            return
        role = robot_role(clause.text)
        if role is None and at and set(clause.text.split()) <= _TOO:
            before = {self._roles[n] for n in self._of(self._clauses[at - 1], "robot")}
            role = before.pop() if len(before) == 1 else None
        if role in ("out", "only") and not certain(clause.text, role):
            # What is said plainly of "it" beside this may still leave it out.
            self._doubted += numbers
            role = None if role == "out" else "doubt"
        if self._crosses(at, clause):
            self._crossed |= {at, at + 1}
        if role is not None and (len(numbers) > 1 or at in self._crossed):
            role = "doubt"
        self._set(numbers, role)

    def _crosses(self, at: int, clause: Clause) -> bool:
        """Whether "not R3 but R4 should be left out" begins here: no cue tells who is out."""
        if at + 1 == len(self._clauses) or not re.search(r"\b(?:not|nicht) ROBOT$", clause.text):
            return False
        after = self._clauses[at + 1]
        return after.opener in ("but", "sondern") and bool(self._of(after, "robot"))

    def _weights(self, at: int, clause: Clause) -> None:
        numbers = self._of(clause, "place", "class")
        if not numbers:
            return
        role = weight_role(clause.text)
        near = self._clauses[at - 1] if at else None
        if role is None and near is not None and near.sentence == clause.sentence:
            role = self._inherited(clause, near)
        self._set(numbers, role)

    def _inherited(self, clause: Clause, before: Clause) -> Role | None:
        """The role that a clause without a cue takes from the one before it, or its opposite."""
        roles = {self._roles[n] for n in self._of(before, "place", "class")}
        if self._of(clause, "robot") or len(roles) != 1:
            return None
        role = roles.pop()
        if role not in ("high", "low"):
            return None
        bare = set(clause.text.split()) <= _FILLERS
        if clause.opener in ("but", "aber", "sondern") and not common.NOT.search(clause.text):
            return None
        other: Role = "low" if role == "high" else "high"
        if common.NOT.search(clause.text):
            return other if bare else None
        if re.search(r"(?:PLACE|CLASS) (?:do|does|can|are|is|schon|doch)$", clause.text):
            return other if common.NOT.search(before.text) else role
        return role if bare else None

    def _shares(self, at: int, clause: Clause) -> None:
        numbers = self._of(clause, "share")
        if not numbers:
            return
        role = share_role(clause.text)
        if len(numbers) > 1:
            role = "doubt"
        bounded = resources.AT_MOST.search(clause.text) or _OF_IT.search(clause.text)
        if role == "doubt" and bounded and at and len(numbers) == 1:
            before = self._clauses[at - 1]
            if "NET" in before.text.split() and not self._of(before, "share"):
                role = "link"
        for number in numbers:
            share = self._text.mentions[number].share
            self._roles[number] = role if share is not None and share.possible else "doubt"

    def _resources(self, at: int, clause: Clause) -> None:
        numbers = self._of(clause, "network", "compute")
        if not numbers:
            return
        role: Role | None = None
        if self._of(clause, "share"):
            role = "none"
        elif resources.WASTE.search(clause.text):
            stopped = negated(clause.text) or resources.STOP.search(clause.text)
            role = "save" if stopped else None
            if role is None:
                self._wasted += numbers
        elif resources.SAVE.search(clause.text):
            role = "doubt" if negated(clause.text) else "save"
        self._set(numbers, role)

    def _others(self, clause: Clause) -> None:
        for number in clause.mentions:
            mention = self._text.mentions[number]
            if mention.kind == "policy":
                self._roles[number] = "doubt" if negated(clause.text) else "policy"
            elif mention.kind == "time":
                self._roles[number] = _time_role(mention, clause.text)
            elif mention.kind == "unknown":
                self._roles[number] = "doubt"

    def _bind(self, at: int, clause: Clause) -> None:
        """Gives what a clause says of "it" to what was named before it, or right behind."""
        if (role := others_role(clause.text)) is not None and not self._of(
            clause, "robot", "share", "network", "compute", "policy"
        ):
            self._handled.add(at)
            if not self._give(at, role, "robot"):
                self._doubt(clause)
            return
        both = common.BOTH.search(clause.text) and not self._of(clause, "robot")
        if both and (role := robot_role(clause.text, alone=True)) is not None:
            for near in self._clauses[max(0, at - 4) : at]:
                self._set([n for n in self._of(near, "robot") if self._roles[n] is None], role)
        others = any(self._text.mentions[n].kind != "time" for n in clause.mentions)
        named = self._of(clause, "robot", "share", "network", "compute")
        if not others or (common.PRONOUN.search(clause.text) and not named):
            role = robot_role(clause.text, alone=True)
            if (
                role == "out"
                and robots.OTHERS.search(clause.text)
                and not common.PRONOUN.search(clause.text)
            ):
                # It is the others who are out.
                role = "doubt"
            ailing = role == "out"
            sure = role not in ("out", "only") or not strange(clause.text, ailing=ailing)
            if role is not None and not (sure and self._give(at, role, "robot")):
                self._doubt(clause)
        if not self._of(clause, "place", "class") and not self._of(clause, "robot", "unknown"):
            weight = weight_role(clause.text)
            if weight is not None and not self._of(clause, "network", "compute", "share"):
                self._give(at, weight, "place", "class")
        elif _THERE.search(clause.text):
            weight = weight_role(clause.text)
            if weight == "high":
                self._give(at, weight, "place")
        if resources.SAVE.search(clause.text) and not clause.mentions:
            self._give(at, "save", "network", "compute")
        if not clause.text.split() or not clause.mentions:
            return
        numbers = self._of(clause, "place", "class")
        if numbers and all(self._roles[n] is None for n in numbers) and at + 1 < len(self._clauses):
            after = self._clauses[at + 1]
            roles = {self._roles[n] for n in self._of(after, "place", "class")}
            bare = set(clause.text.split()) <= _FILLERS and after.sentence == clause.sentence
            if bare and len(roles) == 1 and not self._void[at + 1] and weight_role(after.text):
                self._set(numbers, roles.pop())

    def _give(self, at: int, role: Role, *kinds: str) -> bool:
        """Whether something of a kind was named near that has no other role."""
        for near in (*range(at - 1, max(-1, at - 4), -1), at + 1):
            if not 0 <= near < len(self._clauses):
                continue
            clause = self._clauses[near]
            numbers = self._of(clause, *kinds)
            if not numbers:
                continue
            if any(self._roles[n] not in (None, role) for n in numbers):
                return False
            if near > at and clause.sentence != self._clauses[at].sentence:
                return False
            pointed = common.PRONOUN.search(self._clauses[at].text)
            if self._void[near] and not (clause.asked or pointed):
                return False
            self._set(numbers, role)
            return True
        return False

    def _leftover(self, clause: Clause) -> None:
        """Doubts what a clause wishes of something that nobody knows."""
        if self._clauses.index(clause) in self._handled:
            return
        named = self._of(clause, "robot", "place", "class", "unknown", "policy")
        everybody = set(clause.text.split()) & lexicon.EVERYBODY
        acts = robots.OUT.search(clause.text) or robots.UNUSED.search(clause.text)
        lonely = not named and not self._of(clause, "network", "compute", "share")
        if (
            lonely
            and everybody
            and "out" not in self._roles
            and (acts or robots.ONLY.search(clause.text))
        ):
            self._doubt(clause)
        elif lonely and _STRONG.search(clause.text) and not _THERE.search(clause.text):
            if not self._bound(clause):
                self._doubt(clause)
        elif _is_stranger(clause) or (
            lonely and re.search(r"\b(?:policy|strategy|strategie)\b", clause.text)
        ):
            self._doubt(clause)

    def _bound(self, clause: Clause) -> bool:
        """Whether what a clause says went to something beside it."""
        at = self._clauses.index(clause)
        role = weight_role(clause.text) or robot_role(clause.text, alone=True)
        near = self._clauses[max(0, at - 1) : at + 2]
        return any(
            self._roles[n] == role for c in near for n in self._of(c, "place", "class", "robot")
        )


def _is_stranger(clause: Clause) -> bool:
    """Whether a clause is but something that nobody knows: "the cafeteria"."""
    if clause.mentions or not _ARTICLE.match(clause.text):
        return False
    return not (_OTHERS.search(clause.text) or re.match(r"(?:das|der|die) \w+ ", clause.text))


def _or_none(role: Role | None) -> Role:
    return role or "none"


def read(text: Text) -> Reading:
    """The rules' reading of a wish; settle it (`account`) before anything is made of it."""
    return Rules(text).read()


def _time_role(mention: Mention, clause: str) -> Role:
    """A time that is over belongs to the report that names it, and is unclear elsewhere."""
    if mention.when is None or mention.when.clear:
        return "doubt" if mention.when is None else "when"
    return "none" if mention.when.past and speech.TOLD.search(clause) else "doubt"
