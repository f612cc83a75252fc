"""Tells whether words around a word are German: "am" is a morning's in English only."""

from __future__ import annotations

from collections.abc import Sequence

from llm_gateway.wishes.words import Word

_ENGLISH = frozenset(
    """a about after all and are around ask at before between by every first for from gets has have
    it its keep leave low more most no nobody not of off on only our out please prefer skip starting
    than that the then they till til to today tomorrow tonight too until use watch we with without
    you your""".split()
)
_GERMAN = frozenset(
    """ab alle als auf aus auslassen bei bis bitte das dem den der die ein eine erst fragen frueh
    fuer gegen gilt haben hat heute ihr im ist kein keine lassen mehr mit nach nehmen nicht nur
    oder ohne sind sollen sowie uhr um und uns vom von vor wenig weniger wichtig wichtiger wir
    wird zu zum zur zwischen""".split()
)
_HOURS = frozenset("acht drei eins elf fuenf neun sechs sieben uhr vier zehn zwei zwoelf".split())
"""End an hour that is told in German."""
_NEVER_BEHIND_AM = _ENGLISH | _GERMAN - {"wenig"} | {"aber", "but", "dann", "or", "sharp", "so"}
"""Behind German "am" there is a noun, a name or a superlative, none of these."""


def is_german(words: Sequence[Word]) -> bool:
    """Whether most of the words that only one of the languages has are German.

    >>> from llm_gateway.wishes.words import words
    >>> is_german(words("Gang 2 ist bis sechs wichtig")), is_german(words("watch the docks"))
    (True, False)
    """
    said = [word.text for word in words]
    german = sum(text in _GERMAN or text in _HOURS for text in said)
    return german > sum(text in _ENGLISH for text in said)


def is_morning(words: Sequence[Word], at: int) -> bool:
    """Whether "am", word `at` behind a number, makes a morning of it, and is no German "am".

    >>> from llm_gateway.wishes.words import words
    >>> is_morning(words("until six am watch the docks"), 2)
    True
    >>> is_morning(words("bis sechs am wichtigsten"), 2), is_morning(words("bis 6 am Tor"), 2)
    (False, False)
    """
    number = words[at - 1]
    if at + 1 == len(words) or words[at].start == number.end:
        return True  # "6am".
    behind = words[at + 1].text
    if not behind[0].isalnum() or len(behind) == 1 or behind in _NEVER_BEHIND_AM:
        return True  # A robot's letter, too: "6 am R2 raus".
    if behind.endswith("sten") or number.text in _HOURS:
        return False
    lead = words[at - 2].text if at > 1 else ""
    return lead in _ENGLISH or not (lead in _GERMAN or is_german(words))


def is_german_noun(words: Sequence[Word], at: int, wish: str) -> bool:
    """Whether word `at` is written with a capital, as German nouns are, among German words."""
    return wish[words[at].start].isupper() and is_german(words)
