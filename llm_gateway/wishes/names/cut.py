"""Looks for names in the words of a wish."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.forms import same
from llm_gateway.wishes.numbers import integer_at
from llm_gateway.wishes.tongue import is_morning
from llm_gateway.wishes.words import Word

LIST = frozenset(", and or und oder & / + sowie plus nor noch as well adn nad n udn".split())
"""Between names they make a list of them."""
_NO_NAMES = frozenset(
    """% percent prozent per minutes minute hours hour min h uhr am pm oclock minuten
    stunden""".split()
)
"""Behind a number they say that it is no robot's."""


class Cut:
    """A wish, cut into words."""

    def __init__(self, words: Sequence[Word]) -> None:
        self._words = words

    def text(self, at: int) -> str:
        """The word at a place; empty outside."""
        return self._words[at].text if 0 <= at < len(self._words) else ""

    def number(self, at: int) -> tuple[int, int] | None:
        """The whole number from word `at` on, and the word behind it."""
        return integer_at(self._words, at)

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
            if here > at and self.text(here) in {"-", "_"}:
                here += 1
            said = self.text(here)
            number = self.number(here) if said.isalpha() and part.isdigit() else None
            if number is not None and number[1] > here + 1:
                if number[0] != int(part[:9]):
                    return None
                here = number[1]
                continue
            if not said or not (same(said, part) or (also and said in other_words(part))):
                return None
            here += 1
        return here


def other_words(part: str) -> set[str]:
    """What people call a place's word besides."""
    return set(lexicon.HEADS.get(part, "").split())
