"""Generated wishes as what a model reads and is to write."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

from llm_gateway.wishes import form
from llm_gateway.wishes.names.mentions import Text, find
from llm_gateway.wishes.reading import ROLES, Reading, Role, Verdict
from research.training.wishes.grammar import Grammar, Piece, Split
from research.training.wishes.noise import noisy
from research.training.wishes.sites import draw
from swarm.messages.intent import Site

GERMAN = 0.45
"""Part of the wishes that is German."""


@dataclass(frozen=True, slots=True)
class Sample:
    """A wish with what it means."""

    language: str
    site: Site
    now: datetime
    text: Text
    reading: Reading

    @property
    def prompt(self) -> str:
        """What the model reads."""
        return form.marked(self.text)

    @property
    def answer(self) -> str:
        """What it is to write."""
        return form.answer(self.reading)


def samples(seed: int, split: Split = "train") -> Iterator[Sample]:
    """Without end; equal seeds give equal ones."""
    chance = random.Random(f"{seed} {split}")
    grammars = {language: Grammar(language, split, chance) for language in ("en", "de")}
    while True:
        language = "de" if chance.random() < GERMAN else "en"
        site = draw(chance)
        grammar = grammars[language]
        kind = chance.random()
        if kind < 0.14:
            pieces, nothing = grammar.nothing(site), True
        elif kind < 0.2:
            pieces, nothing = grammar.strange(site), False
        else:
            pieces, nothing = grammar.wish(site), False
        pieces = noisy(pieces, chance)
        now = datetime(2026, 1, 1, tzinfo=timezone(timedelta(hours=chance.randint(-8, 9))))
        now += timedelta(minutes=chance.randrange(525_600))
        sample = labelled(language, site, now, pieces, nothing=nothing)
        if sample is not None:
            yield sample


def labelled(
    language: str, site: Site, now: datetime, pieces: list[Piece], *, nothing: bool
) -> Sample | None:
    """The sample of a wish; None where what is found in it has no one role."""
    text = find("".join(piece.text for piece in pieces), site, now)
    spans: list[tuple[int, int, Piece]] = []
    at = 0
    for piece in pieces:
        spans.append((at, at + len(piece.text), piece))
        at += len(piece.text)
    roles: list[Role] = []
    found: set[int] = set()
    for mention in text.mentions:
        start, end = text.words[mention.first].start, text.words[mention.last - 1].end
        inside = [
            n for n, (a, b, p) in enumerate(spans) if a < end and start < b and p.role is not None
        ]
        said: set[Role] = {role for n in inside if (role := spans[n][2].role) is not None}
        if len(said) > 1:
            return None
        found.update(inside)
        role = said.pop() if said else "none"
        roles.append(role if role in ROLES[mention.kind] and not nothing else "none")
    missed = [
        n for n, (_, _, p) in enumerate(spans) if p.role not in (None, "none") and n not in found
    ]
    strange = any(piece.strange for piece in pieces) or any(
        mention.kind == "unknown" for mention in text.mentions
    )
    wished = any(role not in ("none", "when") for role in roles)
    verdict: Verdict = "all"
    if nothing:
        verdict = "nothing"
    elif strange or missed or not wished:
        verdict = "part"
    return Sample(language, site, now, text, Reading(tuple(roles), verdict))
