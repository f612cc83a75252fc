"""Writes wishes of which it is known what each part means.

A wish is a list of pieces, each with the role of what it names. Templates and fillers are of one
language; those kept for validation are never drawn for training, nor the other way round.
"""

from __future__ import annotations

import random
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from llm_gateway.wishes.reading import Role
from swarm.messages.intent import Site

Split = Literal["train", "validate"]
LANGUAGES = {"en": "english.toml", "de": "german.toml"}
KEPT = 6
"""Every so-manieth template is for validation."""
_SLOT = re.compile(r"\{(\w)\}")
WEIGHTS: dict[str, tuple[Role, float]] = {
    "out": ("out", 5.0), "only": ("only", 2.0), "first": ("first", 2.0), "high": ("high", 5.0),
    "low": ("low", 3.0), "quality": ("quality", 2.0), "link": ("link", 1.6), "free": ("free", 0.5),
    "save": ("save", 2.0), "policy": ("policy", 0.5),
}  # fmt: skip
"""The role that the slots of a list of templates have, and how often one is drawn."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Words of a wish; `role` of what they name, None where they name nothing."""

    text: str
    role: Role | None = None
    strange: bool = False
    """Whether they name what the site does not have, or wish what no role says."""


def phrases(language: str) -> dict[str, Any]:
    """What wishes of a language are made of."""
    path = Path(__file__).parent / LANGUAGES[language]
    return tomllib.loads(path.read_text(encoding="utf-8"))


def templates(words: dict[str, Any], name: str, split: Split) -> list[str]:
    """Those of a list that are for a split."""
    every: list[str] = words["templates"][name]
    kept = every[KEPT - 1 :: KEPT] or every[-1:]
    return kept if split == "validate" else [line for line in every if line not in kept]


class Grammar:
    """Wishes of one language and split."""

    def __init__(self, language: str, split: Split, chance: random.Random) -> None:
        self._chance = chance
        self._words = phrases(language)
        names = (*WEIGHTS, "strange", "nothing")
        self._templates = {name: templates(self._words, name, split) for name in names}

    def wish(self, site: Site) -> list[Piece]:
        """One to four things that are wished, with a time or without, among talk or not."""
        chance, words = self._chance, self._words
        count = chance.choices((1, 2, 3, 4), (5, 4, 2, 1))[0]
        weights = [weight for _, weight in WEIGHTS.values()]
        names = chance.choices(list(WEIGHTS), weights, k=count)
        left = {"r": list(site.robots), "p": list(site.places), "c": list(site.classes)}
        parts: list[list[Piece]] = []
        for name in dict.fromkeys(names):
            template = chance.choice(self._templates[name])
            parts.append(self._filled(template, WEIGHTS[name][0], left))
        if chance.random() < 0.12:
            strange = self._filled(chance.choice(self._templates["strange"]), "none", left)
            strange = [Piece(p.text, p.role, True) for p in strange]
            parts.insert(chance.randrange(len(parts) + 1), strange)
        pieces = self._chained(parts)
        if chance.random() < 0.4:
            pieces = self._timed(pieces)
        return self._dressed(pieces, words)

    def nothing(self, site: Site) -> list[Piece]:
        """Words that wish nothing."""
        left = {"r": list(site.robots), "p": list(site.places), "c": list(site.classes)}
        template = self._chance.choice(self._templates["nothing"])
        pieces = self._filled(template, "none", left)
        if self._chance.random() < 0.5:
            pieces.append(Piece(self._chance.choice(("?", ".", "!", ""))))
        if self._chance.random() < 0.2:
            pieces.insert(0, Piece(self._chance.choice(self._words["before"][:12]) + " "))
        return pieces

    def strange(self, site: Site) -> list[Piece]:
        """A wish that no role says."""
        left = {"r": list(site.robots), "p": list(site.places), "c": list(site.classes)}
        template = self._chance.choice(self._templates["strange"])
        pieces = self._filled(template, "none", left)
        return self._dressed([Piece(p.text, p.role, True) for p in pieces], self._words)

    def _filled(self, template: str, role: Role, left: dict[str, list[str]]) -> list[Piece]:
        pieces: list[Piece] = []
        at = 0
        for slot in _SLOT.finditer(template):
            if slot.start() > at:
                pieces.append(Piece(template[at : slot.start()]))
            pieces += self._slot(slot[1], role, left)
            at = slot.end()
        if template[at:]:
            pieces.append(Piece(template[at:]))
        return pieces

    def _slot(self, slot: str, role: Role, left: dict[str, list[str]]) -> list[Piece]:
        chance, words = self._chance, self._words
        match slot:
            case "r":
                return [Piece(self._robots(left["r"], role), role)]
            case "p":
                return [Piece(self._places(left["p"]), role)]
            case "c":
                return [Piece(self._classes(left["c"]), role)]
            case "x":
                draw = chance.random()
                if draw < 0.42 and left["p"]:
                    return [Piece(self._places(left["p"]), role)]
                if draw < 0.9 or not left["p"]:
                    return [Piece(self._classes(left["c"]), role)]
                near: str = words["near"]
                there = Piece(self._places(left["p"], 1).removeprefix(words["the"]), role)
                return [Piece(self._classes(left["c"]), role), Piece(near), there]
            case "s":
                return [Piece(self._part(), role)]
            case "n":
                network = chance.choice(words["network"])
                if role == "save" and chance.random() < 0.3:
                    return [Piece(chance.choice(words["compute"]), role)]
                return [Piece(network, role if role == "save" else "none")]
            case "y":
                return [Piece(chance.choice(words["policies"]), role)]
            case "t":
                return [Piece(self.time(), role)]
            case _:
                return [Piece(chance.choice(words["strangers"]), "none", True)]

    def _taken(self, left: list[str], most: int) -> list[str]:
        if not left:
            return []
        count = min(len(left), self._chance.choices((1, 2, 3, 4), (12, 4, 2, 1))[0], most)
        taken = self._chance.sample(left, count)
        for name in taken:
            left.remove(name)
        return taken

    def _listed(self, names: list[str], either: bool = False) -> str:
        last = self._chance.choice(self._words["or"] if either else self._words["and"])
        if len(names) > 2 and self._chance.random() < 0.2:
            return " ".join(names)
        return last.join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]

    def _robots(self, left: list[str], role: Role) -> str:
        names = self._taken(left, 4) or ["R99"]
        draw = self._chance.random()
        if draw < 0.12:
            word = self._words["robots" if len(names) > 1 else "robot"]
            return f"{word} {self._listed([name[1:] for name in names])}"
        if draw < 0.2:
            names = [name.lower() for name in names]
        elif draw < 0.23:
            names = [name.replace("R", "R ") for name in names]
        return self._listed(names, either=role in ("first", "out") and draw > 0.9)

    def _places(self, left: list[str], most: int = 3) -> str:
        names = self._taken(left, most) or ["aisle 77"]
        if self._chance.random() < 0.6 and not names[0][-1].isdigit():
            names[0] = self._words["the"] + names[0]
        return self._listed(names)

    def _classes(self, left: list[str]) -> str:
        names = self._taken(left, 2) or ["elephants"]
        said = []
        for name in names:
            others = self._words["classes"].get(name, [name])
            said.append(self._chance.choice(others))
        return self._listed(said)

    def _part(self) -> str:
        chance = self._chance
        tens = chance.randint(1, 9)
        part: str = (
            chance.choice(self._words["parts"])
            .replace("{d}", str(chance.choice((5 * chance.randint(1, 19), 10 * tens, 90, 80))))
            .replace("{f}", str(chance.randint(1, 19) / 20))
            .replace("{g}", str(chance.randint(1, 19) / 20).replace(".", ","))
            .replace("{w}", self._words["tens"][tens - 1])
        )
        return part

    def _clock(self) -> str:
        chance = self._chance
        named = self._words["hours"]
        clock: str = (
            chance.choice(self._words["clocks"])
            .replace("{h}", str(chance.randint(1, 12)))
            .replace("{H}", str(chance.randint(13, 23)))
            .replace("{M}", chance.choice(("00", "30", "15", "45")))
            .replace("{W}", chance.choice(named))
        )
        return clock

    def time(self) -> str:
        """When something begins or ends, or how long it lasts."""
        chance, words = self._chance, self._words
        named = words["hours"]
        draw = chance.random()
        if draw < 0.55:
            text = f"{chance.choice(words['until'])} {self._clock()}"
        else:
            text = chance.choice(words["lasts"] if draw < 0.78 else words["starts"])
        while "{T}" in text:
            text = text.replace("{T}", self._clock(), 1)
        low, high = sorted(chance.sample(range(1, 12), 2))
        text = text.replace("{h}", str(low), 1).replace("{h}", str(high))
        text = text.replace("{H}", str(low + 12), 1).replace("{H}", str(high + 12))
        text = text.replace("{k}", str(chance.choice((2, 3, 4, 5, 10, 15, 20, 30, 45, 90))))
        return text.replace("{w}", chance.choice(named[1:9]))

    def _timed(self, pieces: list[Piece]) -> list[Piece]:
        if self._chance.random() < 0.06:
            text = self._chance.choice(self._words["loose"]).replace("{T}", self._clock())
            return [*pieces, Piece(" "), Piece(text, "when")]
        time = Piece(self.time(), "when")
        if self._chance.random() < 0.35:
            return [time, Piece(self._chance.choice((" ", ", ", ": "))), *pieces]
        return [*pieces, Piece(self._chance.choice((" ", " ", ", "))), time]

    def _chained(self, parts: list[list[Piece]]) -> list[Piece]:
        pieces = list(parts[0])
        for part in parts[1:]:
            pieces += [Piece(self._chance.choice(self._words["join"])), *part]
        return pieces

    def _dressed(self, pieces: list[Piece], words: dict[str, Any]) -> list[Piece]:
        chance = self._chance
        if chance.random() < 0.3:
            pieces = [Piece(chance.choice(words["before"]) + " "), *pieces]
        if chance.random() < 0.22:
            end = chance.choice((" ", ", ", ". "))
            pieces = [*pieces, Piece(end + chance.choice(words["after"]))]
        if chance.random() < 0.12:
            talk, end = chance.choice(words["talk"]), chance.choice((". ", ", ", ", so ", "; "))
            pieces = [Piece(talk + end), *pieces]
        elif chance.random() < 0.05:
            pieces = [*pieces, Piece(chance.choice((". ", ", ")) + chance.choice(words["talk"]))]
        return pieces
