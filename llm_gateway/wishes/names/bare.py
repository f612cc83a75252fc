"""Finds robots by bare numbers, where nothing but a number tells them apart: "die Drei", "7 and 8
out".

A number is a robot's only where it can be nothing else: not a count, an hour, an aisle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set

from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.cut import LIST, Cut
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.words import Word

NUMBER = frozenset({"no", "nr", "number", "numbers", "nummer", "nummern"})
_ENDS = {"", ",", ".", "!", "?", ";", ":", ")"}
_CLOSES = _ENDS - {",", ":"}
"""Behind a list that is a sentence of its own."""
_ARTICLES = {"die", "der", "den", "dem"}
_ROUGHLY = {"gegen", "um"}
"""Before an article they lead to an hour."""
_WHERE = {"an", "auf", "bei", "hinter", "in", "vor"}
"""Before "der Drei" they say that it is a place."""
_MANY = {"bleiben", "brauchen", "duerfen", "haben", "koennen", "muessen", "sind", "sollen",
         "werden"}  # fmt: skip
"""Behind "die Drei" they may be said of three robots."""
_CUES = {"ausser", "except", "exclude", "just", "nur", "ohne", "only", "skip", "without"}
"""Before numbers they say whom they are about."""
_SINGLE = _CUES - {"just", "nur", "only"}
"""Before one number they say so, too; "only 3" are rather three."""
_ACTS = {"ausblenden", "auslassen", "bevorzugen", "first", "off", "out", "raus", "vorziehen",
         "weg", "weglassen", "zuerst"}  # fmt: skip
"""Behind numbers that open a clause they do so."""
_ASKED = {"anfrage", "anfragen", "request", "requests"}
_THEN = {"tonight", "today", "heute", "morgen", "tomorrow", "mehr", "more", "of", "other", "others",
         "to", "von", "oder", "or"}  # fmt: skip
"""Behind a number they may make something else of it."""
_COUNTED = lexicon.ROBOT_WORDS | {"machine", "machines", "ones", "things", "times", "unit", "units"}
"""Behind a number they say what it counts."""
_OR = {"oder", "or"}
_LEAST = 2
_LEAST_ALONE = 3
"""Numbers that are a list without a cue."""
_NEAR = 12
"""Words before a list among which robots, or numbers, are spoken of."""
_PREFERS = {"lieber", "prefer", "preferably", "rather"}
_THAN = {"als", "over", "than"}


def named(first: int, last: int, numbers: Sequence[int], robots: Mapping[int, str]) -> Mention:
    """The robots of some numbers; unknown where one of them has none."""
    names = [robots.get(number) for number in numbers]
    if not names or None in names:
        return Mention("unknown", first, last)
    return Mention("robot", first, last, tuple(dict.fromkeys(name for name in names if name)))


class Bare:
    """Looks for bare numbers in one wish."""

    def __init__(
        self, wish: str, words: Sequence[Word], robots: Mapping[int, str], of_places: Set[int]
    ) -> None:
        self._wish = wish
        self._words = words
        self._cut = Cut(words)
        self._text = self._cut.text
        self._robots = robots
        self._of_places = of_places
        self.seen: set[str] = set()
        """The robots that were named."""

    def at(self, at: int) -> Mention | None:
        """The robots whose bare numbers are written from word `at` on."""
        return self._noun(at) or self._compared(at) or self._listed(at) or self._single(at)

    def _named(self, first: int, last: int, numbers: Sequence[int]) -> Mention:
        return named(first, last, numbers, self._robots)

    def _noun(self, at: int) -> Mention | None:
        """ "die Drei", "ohne Eins": a number as a German noun; unknown where it may be a count."""
        text, before, behind = self._text(at), self._text(at - 1), self._text(at + 1)
        number = self._cut.number(at) if text.isalpha() and self._capital(at) else None
        alone = text == "eins" and before in _CUES
        if number is None or number[1] != at + 1 or not (before in _ARTICLES or alone):
            return None
        if number[0] not in self._robots or self._text(at - 2) in _ROUGHLY:
            return None
        if before in {"der", "dem"} and self._text(at - 2) in _WHERE:
            return None  # "In der Drei" is where something lies.
        if self._cut.counts(at + 1) or behind in _COUNTED | {"-"}:
            return None
        if behind.isalpha() and self._capital(at + 1):
            return None  # "Die Drei Stapler".
        listed = {self._text(at - 2), behind} & LIST
        many = behind in _MANY and not listed
        ranked = self._text(at - 2) == "auf" and number[0] == 1
        if many or ranked or len(self.seen) == number[0] > 1:
            return Mention("unknown", at, at + 1)
        return self._named(at, at + 1, [number[0]])

    def _compared(self, at: int) -> Mention | None:
        """ "prefer four over five": both are robots', as counts are not compared so."""
        found = self._cut.number(at)
        if found is None or found[0] not in self._robots:
            return None
        other = self._cut.number(found[1] + 1) if self._text(found[1]) in _THAN else None
        first = self._text(at - 1) in _PREFERS and other is not None and self._ends(other[1])
        second = self._text(at - 1) in _THAN and self._text(at - 3) in _PREFERS
        second &= self._cut.number(at - 2) is not None and self._ends(found[1])
        return self._named(at, found[1], [found[0]]) if first or second else None

    def _listed(self, at: int) -> Mention | None:
        """ "without 7 and 8", "Sieben, acht, neun raus": numbers that count nothing, as they are
        several."""
        numbers, last = self._numbers(at)
        if len(numbers) < _LEAST or len({*numbers}) < len(numbers):
            return None
        before, behind = self._text(at - 1), self._text(last)
        if not {*numbers} <= {*self._robots} or not self._ends(last):
            return None
        asked = before in {"an", "to"} and self._text(at - 2) in _ASKED
        near = {self._text(n) for n in range(at - _NEAR, at)}
        told = before in {":", "also"} and near & (NUMBER | lexicon.ROBOT_WORDS)
        opens = before in _ENDS and not before.isalpha()
        acted = opens and behind in _ACTS
        alone = (opens and not at) or told
        alone = bool(alone) and behind in _CLOSES and len(numbers) >= _LEAST_ALONE
        if not (before in _CUES or asked or acted or alone):
            return None
        if before in _CUES - _SINGLE and {*numbers} <= self._of_places:
            return Mention("unknown", at, last)  # "Only 2 and 3" may be aisles.
        return self._named(at, last, numbers)

    def _numbers(self, at: int) -> tuple[list[int], int]:
        """The numbers of a list from word `at` on, and the word behind it; none of "two or three",
        which is a count."""
        numbers: list[int] = []
        here = last = at
        while (found := self._cut.number(here)) is not None and not self._cut.counts(found[1]):
            numbers.append(found[0])
            last = here = found[1]
            while self._text(here) in LIST:
                here += 1
        said = {self._text(n) for n in range(at, last)}
        return ([], at) if said & _OR else (numbers, last)

    def _single(self, at: int) -> Mention | None:
        """ "skip 4": a count or a robot, so unknown; there are none of so many, so it is "skip
        twelve" of twelve."""
        found = self._cut.number(at) if self._text(at) not in {"one", "null", "zero"} else None
        if found is None or found[0] not in self._robots or not self._ends(found[1]):
            return None
        opens = self._text(at - 1) in _ENDS and self._text(found[1]) in _ACTS
        if not opens and self._text(at - 1) not in _SINGLE:
            return None
        if found[0] >= len(self._robots) > 1:
            return self._named(at, found[1], [found[0]])
        return Mention("unknown", at, found[1])

    def _ends(self, at: int) -> bool:
        """Whether word `at` makes nothing else of the number before it: a count, a time."""
        text = self._text(at)
        return text in _ENDS or (text not in _THEN | _COUNTED and known(text))

    def _capital(self, at: int) -> bool:
        return at < len(self._words) and self._wish[self._words[at].start].isupper()
