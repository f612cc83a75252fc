"""A reading by rules on its way."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from llm_gateway.wishes.clauses.clause import Clause, clauses
from llm_gateway.wishes.clauses.voids import void
from llm_gateway.wishes.names.mentions import Text
from llm_gateway.wishes.reading import Role

STRONG = re.compile(
    r"\b(?:watch|eyes?|focus\w*|attention|matters?|important|concentrate|monitor|achte[nt]?|auge|"
    r"wichtig\w*|aufpassen|pass auf|keep an eye|look after|ignor\w*|prefer\w*|priority|weight|"
    r"gewicht\w*)\b"
)
"""Cues that are never mere talk."""
POINTS = re.compile(
    r"(?:and |und |so )?(?:thats?|this|they|theyre|these|those|its?|das|dat|des|dies)\b"
    r"(?: (?:is|are|ist|sind|san|comes?|what|where|am|the|one|to|das|dann|place))+\b"
)
"""Begins to say something of what was just named."""
THERE = re.compile(
    r"\b(?:dorthin|where|wo|there|da|dort|here|hier|it|them|dort|daran|darauf|drauf)\b"
)
"""Points to something that is named elsewhere."""
FILLERS = frozenset(
    """please bitte danke thanks thx though halt mal eher rather dont doesnt wont arent much so
    wirklich really PLACE CLASS TIME the die den der das dem also auch nicht not too near at bei
    in im on an am a around beim about is are do does ist sind auf of especially besonders cant
    cannot isnt arent either ned by um well as hingegen and es nich nid net nix no none gar
    hardly barely scarcely kaum little wenig all any likewise ebenso ebenfalls genauso dito ditto
    same goes for dagegen wiederum less weniger neither nor weder noch auch u both beide we
    schon sehr wohl though tho""".split()
)
"""Words beside which something named has the role of the clause before it."""


@dataclass(slots=True)
class Draft:
    """What has been found until now of the clauses of a wish, and of what they name."""

    text: Text
    clauses: list[Clause]
    void: list[bool]
    """Whether each clause is no wish."""
    roles: list[Role | None]
    """Of each mention."""
    unclear: list[str] = field(default_factory=list)
    firm: list[str] = field(default_factory=list)
    """What is unclear whatever a model says."""
    doubted: list[int] = field(default_factory=list)
    """Robots that may be out, by words that are not plain."""
    suspected: dict[int, Role] = field(default_factory=dict)
    """What likely is meant of robots by words that are not plain."""
    wasted: list[int] = field(default_factory=list)
    """Resources of which a report says that they are short."""
    handled: set[int] = field(default_factory=set)
    """Clauses that speak of all the others."""
    nobody: bool = False
    """Whether a clause wishes that no robot at all is asked."""
    supposed: list[Clause] = field(default_factory=list)
    """Clauses that tell on what condition something is wished."""
    denied: set[str] = field(default_factory=set)
    """Policies that are not to decide."""
    crossed: set[int] = field(default_factory=set)
    """Clauses that go on with the opposite of the one before, and share its verb."""

    @classmethod
    def of_text(cls, text: Text) -> Draft:
        """Of a wish of which nothing has been read yet."""
        found = clauses(text)
        idle = [void(text, found, clause) for clause in found]
        return cls(text, found, idle, [None] * len(text.mentions))

    def of(self, clause: Clause, *kinds: str) -> list[int]:
        """The numbers of what a clause names, of some kinds."""
        return [n for n in clause.mentions if self.text.mentions[n].kind in kinds]

    def linked(self, number: int, role: Role | None = None) -> float | None:
        """The part of the link that a part leaves to this swarm, by its role or the given one."""
        share, role = self.text.mentions[number].share, role or self.roles[number]
        if share is None or role not in ("link", "free"):
            return None
        return round(1 - share.value if role == "free" else share.value, 3)

    def set(self, numbers: list[int], role: Role | None) -> None:
        """Gives mentions a role."""
        for number in numbers:
            self.roles[number] = role

    def doubt(self, clause: Clause, *, firmly: bool = False) -> None:
        """Asks back about a clause; `firmly`: whatever a model says."""
        said = self.text.said(clause.first, clause.last).strip(" ,")
        if said:
            (self.firm if firmly else self.unclear).append(said)
