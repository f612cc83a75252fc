"""Reads hours with their minutes: "half past ten", "viertel sechs", "18:00", "17 Uhr 30"."""

from __future__ import annotations

import re
from collections.abc import Sequence

from llm_gateway.wishes.numbers import HUNDRED, integer_at, is_physical, whole
from llm_gateway.wishes.shares import PERCENT, counts_parts
from llm_gateway.wishes.words import Word, text_at

_NO_HOURS = PERCENT | {"per", "hours", "hour", "minutes", "minute", "stunden", "stunde", "minuten",
                       "robots", "roboter", "days", "tage", "tagen"}  # fmt: skip
"""Behind a number they say that it is no hour."""
_UHR = {"uhr", "oclock", "h"}
MILITARY = re.compile(r"(?:[01]\d|2[0-4])[0-5]\d")
"""Hour and minute without a sign: 0600, 1730."""
_OH = {"null", "o", "oh", "zero"}
_AFTER = _NO_HOURS | _UHR
_PAST = {"past", "after", "nach"}
_TWELVES = {"midday": 12, "midnight": 24, "mittag": 12, "mitternacht": 24, "noon": 12}
_ENDS = {"bis", "by", "til", "till", "until"}
"""Before two hours they say that these are one time: "until 5 to 7"."""
_FIVES = {5, 10, 15, 20, 25}
_GOES_ON = {"", ",", ".", "!", ";", "as", "because", "i", "im", "please", "since", "so", "the",
            "then", "we", "weve"}  # fmt: skip
"""Behind "ten of six" they say that it is no part of six things."""


def hour_at(words: Sequence[Word], at: int) -> tuple[int, int, bool, int] | None:
    """The hour that is written from word `at` on, its minute, whether it is one of 24, and the word
    behind it."""
    return _spoken(words, at) or _digits(words, at)


def _spoken(words: Sequence[Word], at: int) -> tuple[int, int, bool, int] | None:
    """ "half past ten", "quarter to six", "ten past four", "halb elf", "viertel nach fünf"."""
    text, lead = words[at].text, text_at(words, at - 1)
    if text in {"a", "ein"} and text_at(words, at + 1) in {"quarter", "viertel"}:
        at, text = at + 1, text_at(words, at + 1)
    if text == "drei" and text_at(words, at + 1) == "viertel":
        at, text = at + 1, "dreiviertel"
    hour = whole(text_at(words, at + 1))
    if text in {"halb", "halber"} and hour is not None and 1 <= hour <= 12:
        return _back(hour, 30, at + 2)
    if (
        text == "half"
        and hour is not None
        and 1 <= hour <= 12
        and text_at(words, at + 2) not in _AFTER
    ):
        return hour, 30, False, at + 2  # British: half six is half past six.
    if text == "viertel" and hour is not None and 1 <= hour <= 12:
        return (hour - 2) % 12 + 1, 15, False, at + 2  # In the south: a quarter on the way to it.
    if text == "dreiviertel" and hour is not None and 1 <= hour <= 12:
        return _back(hour, 15, at + 2)
    named = {"half": 30, "quarter": 15, "viertel": 15}.get(text)
    said = (named, at + 1) if named else integer_at(words, at)
    if said is None:
        return None
    minutes, end = said
    if text_at(words, end) in {"minutes", "minuten"}:
        end += 1
    side = text_at(words, end)
    if side in {"to", "of"} and not named and not _is_clock(words, at, end, lead):
        return None
    if side == "of" and lead not in {*_ENDS, "at"}:
        return None  # "A quarter of three".
    twelve = _TWELVES.get(text_at(words, end + 1))
    if twelve is not None:
        return _around(twelve, minutes, side, end + 2)
    half = text_at(words, end + 1) == "halb" and side in {"nach", "vor"}
    hour = whole(text_at(words, end + 1 + half))
    if hour is None or not 1 <= hour <= 12 or not 0 < minutes < 60:
        return None
    if half:  # "Fünf vor halb sieben".
        return _back(hour, 30 - minutes if side == "nach" else 30 + minutes, end + 3)
    # "Viertel ab eins" in Austria.
    if side in _PAST or (side == "ab" and named and lead in {"bis", "um"}):
        return hour, minutes, False, end + 2
    if side in {"to", "of", "vor", "before"} and text not in {"half"}:
        return _back(hour, minutes, end + 2)
    return None


def _is_clock(words: Sequence[Word], at: int, side: int, lead: str) -> bool:
    """Whether "five to seven", "ten of six" is a clock's: "5 to 7" is a span, as "from five to
    seven" and "ten to midnight"; "five to seven" alone and "until 5 to 7" are a clock's."""
    if text_at(words, side) == "of":
        number = whole(words[at].text)
        return number in _FIVES and text_at(words, side + 2) in _GOES_ON
    if words[at].text.isdecimal() or text_at(words, side + 1) in _TWELVES:
        return lead in _ENDS
    return lead not in {"from", "between", "von"}


def _around(twelve: int, minutes: int, side: str, end: int) -> tuple[int, int, bool, int] | None:
    """So many minutes before or after noon or midnight; "two after midnight" is an hour."""
    if side in _PAST and (side == "past" or minutes in {*_FIVES, 30} - {5}):
        return (twelve % 24, minutes, True, end) if 0 < minutes < 60 else None
    if side in {"to", "vor", "before"} and minutes in _FIVES:
        return twelve - 1, 60 - minutes, True, end
    return None


def _back(hour: int, minutes: int, end: int) -> tuple[int, int, bool, int]:
    """So many minutes before an hour of a clock face."""
    return (hour - 2) % 12 + 1, 60 - minutes, False, end


def _digits(words: Sequence[Word], at: int) -> tuple[int, int, bool, int] | None:
    """ "18:00", "9.30", "six", "17 Uhr 30", "5 o'clock"."""
    text = words[at].text
    minute = 0
    exact = False
    end = at + 1
    for sign in ":.":
        head, _, tail = text.partition(sign)
        tail = tail.removesuffix(":00") if tail.count(":") == 1 else tail
        if head.isdecimal() and len(tail) == 2 and tail.isdecimal() and len(head) <= 2:
            hour, minute = int(head), int(tail)
            if sign == "." and minute > 59:
                return None
            exact = head.startswith("0") or hour > 12
            break
    else:
        if MILITARY.fullmatch(text):
            behind = end + (text_at(words, end) in {"h", "hr", "hrs", "hours", "uhr"})
            return int(text[:2]), int(text[2:]), True, behind
        read = _worded(words, at)
        if text.isdecimal():
            read = (int(text), 0, text.startswith("0") or int(text) > 12, end)
        long = len(text) > (2 if text.isdecimal() else 12)
        if read is None or (long and (text.isdecimal() or read[0] > 24)):
            return None  # "Achtundzwanzig" may be a robot's number; "dreiundzwanzig" is an hour.
        if counts_parts(words, at) or _of_some(words, read[3]):
            return None
        hour, minute, exact, end = read
        if text_at(words, end) in _NO_HOURS or is_physical(words, end):
            return None
    if text_at(words, end) in _UHR:
        end += 1
        more = whole(text_at(words, end))
        if minute == 0 and more is not None and more < 60 and words[end].start:
            after = text_at(words, end + 1)
            if after not in {"%", "percent", "prozent", "minuten", "stunden"}:
                minute, end = more, end + 1
    elif text_at(words, end) == "o" and text_at(words, end + 1) == "clock":
        end += 2
    return hour, minute, exact, end


def _worded(words: Sequence[Word], at: int) -> tuple[int, int, bool, int] | None:
    """ "six", "six thirty", "eighteen hundred"; nothing where more follows: "zero one hundred"."""
    if text_at(words, at) == "ein" and text_at(words, at + 1) == "uhr":
        return 1, 0, False, at + 1
    said = integer_at(words, at)
    if said is None:
        return None
    hour, end = said
    behind = text_at(words, end)
    if (minutes := _minutes(words, end)) is not None:
        exact = hour > 12 or words[at].text in _OH or behind in HUNDRED
        return hour, minutes[0], exact, minutes[1]
    more = integer_at(words, end) if behind.isalpha() else None
    torn = more is not None and (behind in _OH or text_at(words, more[1]) not in _AFTER)
    return None if torn else (hour, 0, False, end)


def _of_some(words: Sequence[Word], at: int) -> bool:
    """Whether the words from `at` on make a number one of things: "nine out of twelve"."""
    at += text_at(words, at) == "out"
    return text_at(words, at) == "of" and whole(text_at(words, at + 1)) is not None


def _minutes(words: Sequence[Word], at: int) -> tuple[int, int] | None:
    """The minutes behind an hour in words: "six thirty", "six oh five", "eighteen hundred"."""
    if text_at(words, at) in HUNDRED:
        return 0, at + 1 + (text_at(words, at + 1) in {"h", "hr", "hrs", "hours", "uhr"})
    oh = text_at(words, at) in _OH
    found = integer_at(words, at + oh)
    if found is None or not text_at(words, at + oh).isalpha() or text_at(words, found[1]) in _AFTER:
        return None
    return found if (found[0] < 10) == oh and found[0] < 60 else None
