"""Reads hours with their minutes: "half past ten", "viertel sechs", "18:00", "17 Uhr 30"."""

from __future__ import annotations

import re
from collections.abc import Sequence

from llm_gateway.wishes.numbers import HUNDRED, integer_at, is_physical, whole
from llm_gateway.wishes.words import Word, text_at

_NO_HOURS = {"%", "percent", "per", "prozent", "hours", "hour", "minutes", "minute", "stunden",
             "stunde", "minuten", "robots", "roboter", "days", "tage", "tagen"}  # fmt: skip
"""Behind a number they say that it is no hour."""
_UHR = {"uhr", "oclock", "h"}
MILITARY = re.compile(r"(?:[01]\d|2[0-4])[0-5]\d")
"""Hour and minute without a sign: 0600, 1730."""
_OH = {"null", "o", "oh", "zero"}
_AFTER = _NO_HOURS | _UHR


def hour_at(words: Sequence[Word], at: int) -> tuple[int, int, bool, int] | None:
    """The hour that is written from word `at` on, its minute, whether it is one of 24, and the word
    behind it."""
    return _spoken(words, at) or _digits(words, at)


def _spoken(words: Sequence[Word], at: int) -> tuple[int, int, bool, int] | None:
    """ "half past ten", "quarter to six", "ten past four", "halb elf", "viertel nach fünf"."""
    text = words[at].text
    if text in {"a", "ein"} and text_at(words, at + 1) in {"quarter", "viertel"}:
        at, text = at + 1, text_at(words, at + 1)
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
    half = text_at(words, end + 1) == "halb" and side in {"nach", "vor"}
    hour = whole(text_at(words, end + 1 + half))
    if hour is None or not 1 <= hour <= 12 or not 0 < minutes < 60:
        return None
    if half:  # "Fünf vor halb sieben".
        return _back(hour, 30 - minutes if side == "nach" else 30 + minutes, end + 3)
    if side in {"past", "after", "nach"}:
        return hour, minutes, False, end + 2
    if side in {"to", "vor", "before"} and text not in {"half"}:
        # "5 to 7" is a span, as "from five to seven"; "five to seven" alone is a clock's.
        if text.isdigit() or text_at(words, at - 1) in {"from", "between", "von"}:
            return None
        return _back(hour, minutes, end + 2)
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
        if head.isdigit() and len(tail) == 2 and tail.isdigit() and len(head) <= 2:
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
        if text.isdigit():
            read = (int(text), 0, text.startswith("0") or int(text) > 12, end)
        if read is None or len(text) > (2 if text.isdigit() else 12):
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


def _minutes(words: Sequence[Word], at: int) -> tuple[int, int] | None:
    """The minutes behind an hour in words: "six thirty", "six oh five", "eighteen hundred"."""
    if text_at(words, at) in HUNDRED:
        return 0, at + 1 + (text_at(words, at + 1) in {"h", "hr", "hrs", "hours", "uhr"})
    oh = text_at(words, at) in _OH
    found = integer_at(words, at + oh)
    if found is None or not text_at(words, at + oh).isalpha() or text_at(words, found[1]) in _AFTER:
        return None
    return found if (found[0] < 10) == oh and found[0] < 60 else None
