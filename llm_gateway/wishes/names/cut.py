"""Looks for names in the words of a wish."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.forms import same
from llm_gateway.wishes.numbers import integer_at, whole
from llm_gateway.wishes.tongue import is_morning
from llm_gateway.wishes.words import Word

LIST = frozenset(", and or und oder & / + sowie plus nor noch as well adn nad n udn".split())
"""Between names they make a list of them."""
RANGE = frozenset({"to", "through", "thru", "bis", "-", "–", ".."})
"""Between two numbers they mean all from one to the other."""
LEADS = frozenset(
    """a also am an and around at auch auf bei beim by dem den der die das for fuer hinter im
    in into near of on or our that the this to um und unser unsere vor watch weil zum
    zur""".split()
)
"""Before a place's main word they say that no other place is meant."""
_NO_NAMES = frozenset(
    """% percent prozent per minutes minute hours hour min h uhr am pm oclock minuten
    stunden""".split()
)
"""Behind a number they say that it is no robot's."""
_NOUGHTS = {"null", "o", "oh", "zero"}
"""Before a number they belong to it: "oh seven"."""


class Cut:
    """A wish, cut into words."""

    def __init__(self, words: Sequence[Word]) -> None:
        self._words = words

    def text(self, at: int) -> str:
        """The word at a place; empty outside."""
        return self._words[at].text if 0 <= at < len(self._words) else ""

    def number(self, at: int) -> tuple[int, int] | None:
        """The whole number from word `at` on, with its noughts, and the word behind it."""
        first = at
        while self.text(first) in _NOUGHTS:
            first += 1
        return integer_at(self._words, first) or integer_at(self._words, at)

    def noughts(self, at: int) -> bool:
        """Whether a number from word `at` on begins with noughts: "oh seven", "null vier"."""
        return self.text(at) in _NOUGHTS and (self.number(at) or (0, 0))[0] > 0

    def opens_point(self, at: int) -> bool:
        """Whether a number begins the next point of a list, and ends no name: "2) no Dash"."""
        return self.text(at + 1) == ")" and "(" not in {word.text for word in self._words[:at]}

    def _digits(self, number: str, at: int) -> int | None:
        """The word behind a number whose digits are said one by one: "two oh four". Without a
        nought among them they might as well be a list."""
        if "0" not in number:
            return None
        for here, digit in enumerate(number, at):
            said = self.text(here)
            if not said.isalpha() or digit != ("0" if said in _NOUGHTS else str(whole(said))):
                return None
        last = at + len(number)
        more = (whole(self.text(last)) or 10) < 10 and not self.counts(last + 1)
        return None if more else last  # "Oh two five".

    def touches(self, at: int) -> bool:
        """Whether a sign stands between two words without a space."""
        around = self._words[at - 1 : at + 2]
        return all(a.end == b.start for a, b in pairwise(around))

    def counts(self, at: int) -> bool:
        """Whether word `at` says of the number before it that it is no name's: "2 hours"."""
        text = self.text(at)
        return text in _NO_NAMES and (text != "am" or is_morning(self._words, at))

    def named(self, name: Sequence[str], at: int, *, also: bool) -> int | None:
        """The word behind a name that is written from word `at` on; `also` in other words."""
        here = at
        for part in name:
            here += here > at and self._joins(here)
            said = self.text(here)
            digits = self._digits(part, here) if part.isdecimal() else None
            if digits is not None:
                here = digits
                continue
            number = self.number(here) if said.isalpha() and part.isdecimal() else None
            if number is not None and number[1] > here + 1:
                if number[0] != int(part[:9]):
                    return None
                here = number[1]
                continue
            if not said or not (same(said, part) or (also and said in other_words(part))):
                return None
            here += 1
        return here

    def _joins(self, at: int) -> bool:
        """Whether word `at` is a sign within a name: "FTS-3", "Halle 1/2", "2. OG"."""
        sign = self.text(at)
        if sign in {"-", "_"}:
            return True
        numbered = sign in {"/", "."} and self.text(at - 1).isdecimal()
        return numbered and self._words[at - 1].end == self._words[at].start


def other_words(part: str) -> set[str]:
    """What people call a place's word besides."""
    return set(lexicon.HEADS.get(part, "").split()) | plurals(part)


def plurals(part: str) -> set[str]:
    """What people call several places that are numbered by that word."""
    return set(lexicon.MANY.get(part, "").split())
