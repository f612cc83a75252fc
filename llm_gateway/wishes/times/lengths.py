"""Reads lengths of time: "three hours", "an hour and a half", "eine halbe Stunde"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import timedelta

from llm_gateway.wishes.numbers import AND, counted, whole
from llm_gateway.wishes.shares import FRACTIONS, QUALITY
from llm_gateway.wishes.words import Word, text_at

UNITS = {
    "second": 1, "seconds": 1, "sec": 1, "sekunde": 1, "sekunden": 1,
    "minute": 60, "minutes": 60, "min": 60, "mins": 60, "minuten": 60,
    "hour": 3600, "hours": 3600, "hr": 3600, "hrs": 3600, "h": 3600, "stunde": 3600,
    "stunden": 3600, "std": 3600, "stuendchen": 3600, "viertelstunde": 900, "viertelstunden": 900,
    "viertelstuendchen": 900, "dreiviertelstunde": 2700, "dreiviertelstuendchen": 2700,
    "stund": 3600, "stond": 3600, "stuendli": 3600, "stuenderl": 3600, "viertelstund": 900,
    "viertelstuendli": 900, "dreiviertelstund": 2700, "halbstunde": 1800,
    "day": 86400, "days": 86400, "tag": 86400, "tage": 86400, "tagen": 86400,
}  # fmt: skip
_ONES = {"a", "an", "one", "ne", "nen", "ner", "ein", "eine", "einen", "einer", "einem", "the",
         "die", "der", "next",
         "naechste", "naechsten", "naechster"}  # fmt: skip

_MINUTES = re.compile(r"[0-5]\d")
_QUARTERS = {"quarter", "quarters", "viertel"}
_BEHIND_NUMBERS = {"einhalb": 0.5, "einviertel": 0.25, "eindreiviertel": 0.75}
_WHOSE = {"am", "bandwidth", "der", "des", "link", "network", "of", "the", "vom", "von"}
"""Behind a part they say that it is none of an hour: "two hours and a quarter of the link"."""
LASTS = {"another", "for", "fuer", "in", "naechsten", "next", "noch", "within"}
"""Before a number they say that it is one of minutes."""
_OF = {":", "=", "at", "auf", "bei", "is", "ist", "of", "von"}
"""Between "quality" and its number."""


def length_at(words: Sequence[Word], at: int) -> tuple[timedelta, int] | None:
    """The length of time that is written from word `at` on, and the word behind it."""
    found = _length(words, at)
    return None if found is None else with_more(words, with_part(words, found))


def with_part(words: Sequence[Word], found: tuple[timedelta, int]) -> tuple[timedelta, int]:
    """A length with the part of its unit that goes on with it: "two hours and a half"."""
    seconds = UNITS.get(text_at(words, found[1] - 1))
    more = and_part(words, found[1])
    if more is None or seconds is None:
        return found
    behind = text_at(words, more[1])
    if behind in {"of", *UNITS} or (more[0] != 0.5 and behind in _WHOSE):
        return found
    return found[0] + timedelta(seconds=more[0] * seconds), more[1]


def with_more(words: Sequence[Word], found: tuple[timedelta, int]) -> tuple[timedelta, int]:
    """A length with the smaller one that goes on with it: "an hour and ten minutes"."""
    here = found[1] + (text_at(words, found[1]) in {"and", "und", "plus"})
    more = _length(words, here)
    whole_hours = found[0].seconds % UNITS["hour"] == 0
    if more is None or not whole_hours or more[0].total_seconds() >= UNITS["hour"]:
        return found
    return found[0] + more[0], more[1]


def _length(words: Sequence[Word], at: int) -> tuple[timedelta, int] | None:
    text = text_at(words, at)
    if text == "ein" and (more := and_part(words, at + 1)) is not None:
        return _times(1 + more[0], words, more[1])
    if (broken := _broken(words, at)) is not None:
        return _times(broken[0], words, broken[1] + (text_at(words, broken[1]) in _ONES))
    if text in {"half", "halbe", "halben"}:
        skip = 2 if text_at(words, at + 1) in _ONES else 1
        return _times(0.5, words, at + skip)
    if text in _ONES and text_at(words, at + 1) in {"half", "halbe", "halben"}:
        return _times(0.5, words, at + 2)
    quarter = 1 if text in _ONES else 0
    if (unit := _quarters(words, at + quarter)) is not None:
        return _times(0.25, words, unit)
    if text_at(words, at + quarter) == "dreiviertel":
        return _times(0.75, words, at + quarter + 1)
    if text == "anderthalb":
        return _times(1.5, words, at + 1)
    for ending, part in _BEHIND_NUMBERS.items():
        before = text.removesuffix(ending)
        number = 1 if before == "ein" else whole(before)
        if before != text and number is not None:
            return _times(number + part, words, at + 1)
    said = counted(words, at)
    if text in _ONES and text_at(words, at + 1) == "second":
        return None  # "A second look".
    if text in _ONES and (said is None or said[1] == at + 1):
        found = _times(1, words, at + 1)
        if found is not None:
            return found
    if said is None:
        return None
    amount, end = said
    if text_at(words, end) == "min" and _is_bound(words, at, amount):
        return None
    more = and_part(words, end) or _broken(words, end)
    if more is not None:
        return _times(amount + more[0], words, more[1])
    if text_at(words, end) == "-":
        end += 1
    if (unit := _quarters(words, end)) is not None:
        return _times(amount / 4, words, unit)
    if text_at(words, end) == "ganze":
        end += 1
    return _times(amount, words, end)


def and_part(words: Sequence[Word], at: int) -> tuple[float, int] | None:
    """The part that "and a half", "and three quarters" add, and the word behind them."""
    at += text_at(words, at) == "-"
    if text_at(words, at) not in AND:
        return None
    at += 1 + (text_at(words, at + 1) == "-")
    top = {"a": 1, "ein": 1, "eine": 1, "three": 3, "drei": 3}.get(text_at(words, at))
    at += 1 + (text_at(words, at + 1) == "-")
    half = text_at(words, at) in {"half", "halb", "halbe"} and top == 1
    if top is None or not (half or text_at(words, at) in _QUARTERS):
        return None
    return 0.5 if half else top / 4, at + 1 + (text_at(words, at + 1) == "-")


def _broken(words: Sequence[Word], at: int) -> tuple[float, int] | None:
    """ "1/2", "¾", and the word behind it."""
    if text_at(words, at) in FRACTIONS:
        return FRACTIONS[text_at(words, at)], at + 1
    part = FRACTIONS.get(f"{text_at(words, at)}⁄{text_at(words, at + 2)}")
    return (part, at + 3) if part is not None and text_at(words, at + 1) == "/" else None


def _quarters(words: Sequence[Word], at: int) -> int | None:
    """The word behind "quarters of an", or "viertel", from word `at` on."""
    if text_at(words, at) not in _QUARTERS:
        return None
    if text_at(words, at + 1) != "of":
        return at + 1
    return at + 3 if text_at(words, at + 2) in _ONES else None


def _is_bound(words: Sequence[Word], at: int, amount: float) -> bool:
    """Whether "min" behind number `at` means "at least": "0.7 min.", "quality 90 min"."""
    if text_at(words, at - 1) in LASTS:
        return False
    before = at - 1
    while text_at(words, before) in _OF:
        before -= 1
    return (amount <= 1 and not words[at].text.isalnum()) or bool(
        QUALITY.fullmatch(text_at(words, before))
    )


def _times(amount: float, words: Sequence[Word], at: int) -> tuple[timedelta, int] | None:
    seconds = UNITS.get(text_at(words, at))
    if seconds is None or not 0 < amount <= 10_000:
        return None
    minutes = text_at(words, at + 1)
    if (
        text_at(words, at) == "h"
        and _MINUTES.fullmatch(minutes)
        and words[at].end == words[at + 1].start
    ):
        return timedelta(hours=amount, minutes=int(minutes)), at + 2  # "1h30".
    return timedelta(seconds=amount * seconds), at + 1
