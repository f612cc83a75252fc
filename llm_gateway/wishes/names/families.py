"""Finds robots by what their names have in common: "both scouts" of scout-a and scout-b."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from llm_gateway.wishes.names.forms import same
from llm_gateway.wishes.numbers import whole
from llm_gateway.wishes.words import key

_ALL = {"all", "alle", "allen", "aller", "every", "saemtliche", "saemtlichen"}
_BOTH = {"both", "beide", "beiden", "beider"}
_ARTICLES = {"the", "our", "die", "den", "der", "of"}
_ROBOTS = {"bots", "robotern", "roboter", "robots", "units"}
"""Behind what several names begin with they mean all of these: "the scout robots"."""
_LEAST = 2


def families(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Robots by the word with which several names begin.

    >>> families(["scout-a", "scout-b", "heron"])
    {'scout': ('scout-a', 'scout-b')}
    """
    found: dict[str, tuple[str, ...]] = {}
    for name in names:
        head, *rest = key(name)
        if rest and head.isalpha():
            found[head] = (*found.get(head, ()), name)
    return {head: held for head, held in found.items() if len(held) >= _LEAST}


def family_at(
    words: Sequence[str], known: Mapping[str, tuple[str, ...]], *, compared: bool = False
) -> tuple[tuple[str, ...], int] | None:
    """The robots, and the number of words, where the words begin with all of a family; no robots
    where there are not so many as are said. `compared`: they stand behind "before" or "than", where
    "the scouts" are all of them.

    >>> family_at(["both", "scouts", "first"], {"scout": ("scout-a", "scout-b")})
    (('scout-a', 'scout-b'), 2)
    """
    many: int | None = None
    quantified = compared
    for at, word in enumerate(words):
        if word in _ALL | _BOTH or (number := whole(word)) is not None:
            quantified = True
            many = 2 if word in _BOTH else many if word in _ALL else number
        elif word not in _ARTICLES:
            lettered = at and words[at - 1] in _ARTICLES  # "As" is no plural of "A".
            head = next((h for h in known if same(word, h) or (lettered and word == h + "s")), None)
            of_robots = list(words[at + 1 : at + 2]) + list(words[at + 2 : at + 3])
            kind = word == head and {*of_robots[: 1 + (of_robots[:1] == ["-"])]} & _ROBOTS
            if head is None or not (kind or (quantified and word != head)):
                return None
            held = known[head]
            if kind:
                at += 1 + (of_robots[0] == "-")
            return (held if many in (None, len(held)) else ()), at + 1
    return None
