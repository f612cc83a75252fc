"""Cuts a wish into words that compare equal however they are written."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

_SHORT = {"w/o": "without", "w/": "with", "u.": "und", "1st": "first", "2nd": "second",
          "3rd": "next"}  # fmt: skip
"""What people write for a word, signs and all."""
_BOUNDS = {">=": "mindestens", "≥": "mindestens", "<=": "hoechstens", "≤": "hoechstens",
           ">": "mindestens", "<": "hoechstens"}  # fmt: skip
_BOUND = re.compile(r"[<>](?=\s*\d)")
"""A sign that bounds the number behind it."""
_SOUTHERN = {"d": "die", "s": "das"}
"""Articles that lean on the word behind them: "d'Leut", "s'Tor"."""
_ARROW = re.compile(r"[-=]+>")
_WORD = re.compile(
    r"(?<!\w)[ds]['’](?=(?!you|ye|ya)[^\W\d_]{3})|\bw/o\b|\bw/(?=\s)|\bu\.(?=\s)|"
    r"(?<!the )(?<!from )(?<!til )(?<!till )\b(?:1st|2nd|3rd)(?= pls| please| bitte)|"
    r"\b(?:1st|2nd|3rd)(?= choice| pick| best| prio|[ ,;.!]*$|[,;.!] )|"
    r"[<>]=|[-=]+>|(?<!\w)\.\d+|\d+(?:[.,:]\d+)*|[^\W\d_]+(?:['’][^\W\d_]+)*|\S",
    re.IGNORECASE,
)
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "’": "", "'": ""})
_LEAST_FUZZY = 5
"""Letters of a word in which one slip of the keyboard is forgiven."""


@dataclass(frozen=True, slots=True)
class Word:
    """One word, number or sign; letters and digits that touch ("R3", "5pm") are two words."""

    text: str
    """Folded: see `fold`."""
    start: int
    end: int
    """Characters of the wish."""


def fold(text: str) -> str:
    """In small letters, compatible forms made equal, without umlauts and apostrophes.

    >>> fold("Don’t drück")
    'dont drueck'
    """
    plain = unicodedata.normalize("NFKC", text).casefold().translate(_UMLAUTS)
    return plain or text


def words(text: str) -> list[Word]:
    """The words of a wish, in order."""
    return [
        Word(_long(m.group(), bounds=bool(_BOUND.match(text, m.start()))), m.start(), m.end())
        for m in _WORD.finditer(text)
    ]


def text_at(words: Sequence[Word], at: int) -> str:
    """The word at a place; empty outside."""
    return words[at].text if 0 <= at < len(words) else ""


def _long(said: str, *, bounds: bool) -> str:
    """A word folded, in full; arrows are one sign. `bounds`: a number stands behind it."""
    folded = fold(said)
    if folded in _SOUTHERN and folded != said.casefold():
        return _SOUTHERN[folded]
    if _ARROW.fullmatch(folded):
        return "→"
    if len(folded) == 1 and folded in "<>" and not bounds:
        return folded
    return _SHORT.get(folded) or _BOUNDS.get(folded, folded)


def key(name: str) -> tuple[str, ...]:
    """A name's words without the signs that people leave out."""
    return tuple(word.text for word in words(name) if word.text not in "-_./")


def alike(said: str, meant: str) -> bool:
    """Whether a word is another one with at most one slip: a letter more, less, wrong, or two
    exchanged; never the first one.

    >>> alike("dokcs", "docks"), alike("tracks", "racks"), alike("aisle", "isles")
    (True, False, False)
    """
    if said == meant:
        return True
    if len(meant) < _LEAST_FUZZY or len(said) < _LEAST_FUZZY - 1 or said[0] != meant[0]:
        return False
    if not (said.isalpha() and meant.isalpha()) or abs(len(said) - len(meant)) > 1:
        return False
    at = next((i for i, (a, b) in enumerate(zip(said, meant, strict=False)) if a != b), None)
    if at is None:
        return True
    swapped = said[at : at + 2] == meant[at : at + 2][::-1] and said[at + 2 :] == meant[at + 2 :]
    wrong = said[at + 1 :] == meant[at + 1 :]
    more = said[at + 1 :] == meant[at:]
    less = said[at:] == meant[at + 1 :]
    return swapped or wrong or more or less


def exchanged(said: str) -> list[str]:
    """A word with each two neighbouring letters but the first exchanged, as fingers do; none of a
    short word.

    >>> exchanged("nehmne")
    ['nhemne', 'nemhne', 'nehnme', 'nehmen']
    """
    if len(said) < _LEAST_FUZZY or not said.isalpha():
        return []
    ways = [said[:n] + said[n + 1] + said[n] + said[n + 2 :] for n in range(1, len(said) - 1)]
    return list(dict.fromkeys(way for way in ways if way != said))
