"""Finds the robots that a wish tells by number: "robots 5 to 8", "number five", "die Drei"."""

from __future__ import annotations

import re
from collections.abc import Sequence, Set

from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.bare import NUMBER, Bare, named
from llm_gateway.wishes.names.cut import LIST, RANGE, Cut
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.numbers import whole
from llm_gateway.wishes.words import Word, key
from swarm.messages.intent import Site

_DIGITS = re.compile(r"\d+")
_SEVERAL = {"bots", "numbers", "nummern", "robotern", "robots"}
"""Of several robots in any case."""
_OF_SEVERAL = {"alle", "allen", "die"}
"""Before "Roboter" they say that several are meant."""
_NO_ROBOTS = frozenset(
    """area corner group job line list order part place point position quality round spot strategie
    strategy stelle team""".split()
)
"""Before "number 4" they say whose it is."""
_RANKS = {"are", "as", "is", "its", "my", "our", "ist", "sind", "als"}
"""Before "number one" they say how much something counts."""
_RANKED = {"concern", "job", "priority", "rule", "thing", "worry"}
"""So they do behind it, or before it."""
_TILL = {"til", "till", "until"}
"""Between two numbers of several robots they mean a range, too: no robot is alone then."""
_REST = {"even": 0, "geraden": 0, "odd": 1, "ungeraden": 1}
_NUMBERS = {"number", "numbers", "numbered", "nummern"}
"""Behind "odd" they say that robots are told by what is left of their numbers, halved."""


def _ends_in_number(name: Sequence[str]) -> bool:
    return bool(name) and name[-1].isdecimal()


class Numbered:
    """Looks for robots that are told by number in one wish."""

    def __init__(self, wish: str, words: Sequence[Word], site: Site) -> None:
        self._cut = Cut(words)
        self._text = self._cut.text
        self._places = [told for place in site.places if _ends_in_number(told := key(place))]
        held: dict[int, list[str]] = {}
        for name in site.robots:
            digits = _DIGITS.findall(name)
            if len(digits) == 1:
                held.setdefault(int(digits[0][:9]), []).append(name)
        self._robots = {number: names[0] for number, names in held.items() if len(names) == 1}
        heads = {key(name)[:-1] for name in site.robots}
        self._alike = len(self._robots) == len(site.robots) and len(heads) == 1
        """Whether nothing but a number tells the site's robots apart."""
        of_places = {int(place[-1][:9]) for place in self._places}
        self._bare = Bare(wish, words, self._robots, of_places)

    def see(self, names: Sequence[str]) -> None:
        """Tells which robots were named."""
        self._bare.seen |= {*names}

    def at(self, at: int, places: Sequence[str]) -> Mention | None:
        """The robots that are told by number from word `at` on; unknown where it may be another
        number of the `places` that were named before."""
        if self._text(at) in lexicon.ROBOT_WORDS:
            return self._counted(at, at + 1)
        found = self._called(at)
        if found is None and self._alike:
            found = self._halved(at) or self._bare.at(at)
        if found is None:
            return None
        heads = {name[:-1] for place in places if _ends_in_number(name := key(place))}
        taken = {self._robots.get(int(p[-1][:9])) for p in self._places if p[:-1] in heads}
        if taken.isdisjoint(found.names):
            return found
        return Mention("unknown", found.first, found.last)

    def _halved(self, at: int) -> Mention | None:
        """ "the odd-numbered robots", "die geraden Nummern", and then "the even ones"."""
        rest = _REST.get(self._text(at))
        here = at + 1 + (self._text(at + 1) == "-")
        told = self._text(here) in _NUMBERS
        if self._text(here) == "ones":
            told = any(self._text(n) in _NUMBERS and self._text(n - 1) in {*_REST, "-"}
                       for n in range(at))  # fmt: skip
        if rest is None or not told or self._cut.number(here + 1) is not None:
            return None  # "Even numbers 3 and 4".
        numbers = [number for number in self._robots if number % 2 == rest]
        return named(at, here + 1, numbers, self._robots)

    def _called(self, at: int) -> Mention | None:
        """ "number five", "Nr. 7", "Nummern 2 und 5"."""
        text, before = self._text(at), self._text(at - 1)
        if text not in NUMBER or (text == "no" and self._text(at + 1) != "."):
            return None
        if before.isalpha() and (before in _NO_ROBOTS or not known(before)):
            return None
        first = at + 1 + (self._text(at + 1) == ".")
        number = self._number(first)
        if number is None or not (self._alike or number[0] in self._robots):
            return None
        if number[0] == 1 and (before in _RANKS | _RANKED or self._text(number[1]) in _RANKED):
            return None
        return self._counted(at, first)

    def _counted(self, at: int, here: int) -> Mention | None:
        """ "robots 2 and 5", "robot number three", "Roboter drei und vier", "robots 5 to 8"; the
        number is looked for from word `here` on."""
        while self._text(here) in {*NUMBER, "."}:
            here += 1
        numbers: list[int] = []
        last = here
        while (found := self._number(here)) is not None and not self._cut.counts(found[1]):
            numbers.append(found[0])
            last = here = found[1]
            while self._text(here) in LIST:
                here += 1
        if not numbers:
            return None
        till = len(numbers) == 1 and self._several(at)
        high = self._high(numbers[-1], last, RANGE | _TILL if till else RANGE)
        if high is not None:
            plain = self._several(at) and (len(numbers) == 1 or self._text(last) != "bis")
            # More numbers than robots: some have none, and nobody counts to a billion.
            known_so = plain and high[0] - numbers[-1] < len(self._robots)
            numbers = [*numbers, *range(numbers[-1], high[0] + 1)] if known_so else []
            last = high[1]
        return named(at, last, numbers, self._robots)

    def _high(self, low: int, at: int, signs: Set[str]) -> tuple[int, int] | None:
        """The last robot's number of a range, behind its first one and one of the signs, and the
        word behind it."""
        if self._text(at) not in signs:
            return None
        found = self._number(at + 1)
        if found is None or self._cut.counts(found[1]) or found[0] <= low:
            return None
        return found

    def _several(self, at: int) -> bool:
        """Whether word `at` says that several robots are meant, so that a range is no hour: "robots
        4 to 8"; "Roboter 4 bis 8" may be one robot until eight."""
        return self._text(at) in _SEVERAL or self._text(at - 1) in _OF_SEVERAL

    def _number(self, at: int) -> tuple[int, int] | None:
        """The number from word `at` on, be it of "number four's"."""
        return self._cut.number(at) or self._owned(at)

    def _owned(self, at: int) -> tuple[int, int] | None:
        number = whole(self._text(at).removesuffix("s"))
        return None if number is None else (number, at + 1)
