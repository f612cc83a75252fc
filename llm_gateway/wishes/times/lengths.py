"""Reads lengths of time: "three hours", "an hour and a half", "eine halbe Stunde"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import timedelta

from llm_gateway.wishes.numbers import counted, whole
from llm_gateway.wishes.shares import QUALITY
from llm_gateway.wishes.words import Word, text_at

UNITS = {
    "second": 1, "seconds": 1, "sec": 1, "sekunde": 1, "sekunden": 1,
    "minute": 60, "minutes": 60, "min": 60, "mins": 60, "minuten": 60,
    "hour": 3600, "hours": 3600, "hr": 3600, "hrs": 3600, "h": 3600, "stunde": 3600,
    "stunden": 3600, "std": 3600, "stuendchen": 3600, "viertelstunde": 900, "viertelstunden": 900,
    "viertelstuendchen": 900, "dreiviertelstunde": 2700, "dreiviertelstuendchen": 2700,
    "day": 86400, "days": 86400, "tag": 86400, "tage": 86400, "tagen": 86400,
}  # fmt: skip
_ONES = {"a", "an", "one", "ne", "nen", "ner", "ein", "eine", "einen", "einer", "einem", "the",
         "die", "der", "next",
         "naechste", "naechsten", "naechster"}  # fmt: skip

_MINUTES = re.compile(r"[0-5]\d")
LASTS = {"another", "for", "fuer", "in", "naechsten", "next", "noch", "within"}
"""Before a number they say that it is one of minutes."""
_OF = {":", "=", "at", "auf", "bei", "is", "ist", "of", "von"}
"""Between "quality" and its number."""


def length_at(words: Sequence[Word], at: int) -> tuple[timedelta, int] | None:
    """The length of time that is written from word `at` on, and the word behind it."""
    found = _length(words, at)
    return None if found is None else with_more(words, found)


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
    if text == "ein" and (last := and_half(words, at + 1)) is not None:
        return _times(1.5, words, last)
    if text in {"half", "halbe", "halben"}:
        skip = 2 if text_at(words, at + 1) in _ONES else 1
        return _times(0.5, words, at + skip)
    if text in _ONES and text_at(words, at + 1) in {"half", "halbe", "halben"}:
        return _times(0.5, words, at + 2)
    quarter = 1 if text in _ONES else 0
    if text_at(words, at + quarter) == "quarter" and text_at(words, at + quarter + 1) == "of":
        return _times(0.25, words, at + quarter + 3)
    if text in {"anderthalb", "eineinhalb"}:
        return _times(1.5, words, at + 1)
    if text.endswith("einhalb") and (number := whole(text.removesuffix("einhalb"))) is not None:
        return _times(number + 0.5, words, at + 1)
    said = counted(words, at)
    if text in _ONES and text_at(words, at + 1) == "second":
        return None  # "A second look".
    if text in _ONES and (said is None or said[1] == at + 1):
        found = _times(1, words, at + 1)
        if found and (last := and_half(words, found[1])) is not None:
            return found[0] * 1.5, last
        return found
    if said is None:
        return None
    amount, end = said
    if text_at(words, end) == "min" and _is_bound(words, at, amount):
        return None
    if (last := and_half(words, end)) is not None:
        return _times(amount + 0.5, words, last)
    if text_at(words, end) == "-":
        end += 1
    if text_at(words, end) == "ganze":
        end += 1
    return _times(amount, words, end)


def and_half(words: Sequence[Word], at: int) -> int | None:
    """The word behind "and a half", from word `at` on."""
    for part in ({"and", "und"}, {"a", "ein", "eine"}, {"half", "halb", "halbe"}):
        at += text_at(words, at) == "-"
        if text_at(words, at) not in part:
            return None
        at += 1
    return at + (text_at(words, at) == "-")


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
