"""Tells whether a word is another one in another form: a plural, a slip, a number as a word."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.names.things import CLASSES
from llm_gateway.wishes.numbers import whole
from llm_gateway.wishes.words import alike

_PLURALS = ("s", "es", "n", "en", "e", "er", "ern", "r")
_SHORT_PLURALS = ("", "s", "es", "e")
_LONG_PLURALS = (*_SHORT_PLURALS, "n", "en", "er", "ern", "nen")
_INFLECTED = {"achte", "neune", "sechse", "siebene", "fuenfe"}
"""Rather a verb or an hour than a name's number."""
_SIDES = {"east", "hinten", "links", "middle", "mitte", "nord", "north", "oben", "ost", "rechts",
          "south", "sued", "unten", "vorne", "west"}  # fmt: skip
"""Behind a name's main word they say which one it is."""
_IRREGULAR = (("y", "ies"), ("f", "ves"), ("fe", "ves"), ("man", "men"), ("ouse", "ice"))
_LEAST_HEAD = 4
_LEAST = 3
"""Letters of a word that may have a plural."""


def same(said: str, meant: str) -> bool:
    """Whether a word is another one, in another form of it, or with a slip.

    >>> same("calves", "calf"), same("two", "2"), same("dokcs", "docks"), same("cat", "car")
    (True, True, True, False)
    """
    if said == meant or (alike(said, meant) and not known(said)):
        return True
    if meant.isdecimal() and said.isalpha() and said not in _INFLECTED:
        number = whole(said)
        number = whole(said.removesuffix("s")) if number is None else number  # "Unit four's".
        return number == int(meant[:9])
    if not (said.isalpha() and meant.isalpha()) or min(len(said), len(meant)) < _LEAST:
        return False
    longer, shorter = (said, meant) if len(said) > len(meant) else (meant, said)
    if longer in {shorter + ending for ending in _PLURALS}:
        return True
    return any(
        shorter.endswith(one) and longer == shorter.removesuffix(one) + many
        for one, many in _IRREGULAR
    )


def is_head(said: str, name: Sequence[str]) -> bool:
    """Whether a word is the main one of a name of several, or ends it in German.

    >>> is_head("hall", ["dinosaur", "hall"]), is_head("graben", ["orchestergraben"])
    (True, True)
    """
    words = [word for word in name if word.isalpha()]
    if len(said) < _LEAST_HEAD or not said.isalpha() or not words:
        return False
    if len(name) > 1 and said == words[-1 if words[-1] not in _SIDES else 0]:
        return True
    return len(words[-1]) >= len(said) + _LEAST and words[-1].endswith(said)


def are_heads(said: str, name: Sequence[str]) -> bool:
    """Whether a word is the plural of the main one of a name of several, or of what ends it.

    >>> are_heads("docks", ["inbound", "dock"]), are_heads("hallen", ["werkhalle"])
    (True, True)
    """
    words = [word for word in name if word.isalpha()]
    if len(said) < _LEAST_HEAD or not words:
        return False
    main = words[-1 if words[-1] not in _SIDES else 0]
    plural = said != main and len(name) > 1 and same(said, main)
    return plural or any(
        is_head(said.removesuffix(ending), [main]) for ending in _PLURALS if said.endswith(ending)
    )


@lru_cache(maxsize=4096)
def called(said: str, name: str) -> bool:
    """Whether a word is what people call the kind of object of that name, or its plural.

    >>> called("Stapler".lower(), "forklift"), called("kaelber", "calf"), called("kalk", "calf")
    (True, True, False)
    """
    others = CLASSES.get(name, "").split()
    turned = any(said == way + ending for way in _umlauts(name) for ending in _LONG_PLURALS)
    return turned or said in others or any(_plural(said, other) for other in others)


def _plural(said: str, other: str) -> bool:
    """Whether a word is another one with an ending, or an umlaut, or both."""
    if len(other) < _LEAST or not said.startswith(other[0]):
        return False
    plain = _SHORT_PLURALS if len(other) == _LEAST else _LONG_PLURALS
    if said.startswith(other) and said != "better":
        return said.removeprefix(other) in plain
    return any(said == way + ending for way in _umlauts(other) for ending in _LONG_PLURALS)


def _umlauts(word: str) -> Iterator[str]:
    """A word with each of its vowels turned as German plurals do: "kran", "kraen"."""
    for at, letter in enumerate(word):
        if letter in "aou" and word[at + 1 : at + 2] != "e":
            yield word[:at] + letter + "e" + word[at + 1 :]
    if "au" in word:
        yield word.replace("au", "aeu", 1)
