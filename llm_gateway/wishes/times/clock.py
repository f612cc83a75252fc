"""Reads points in time as people say them: "six", "half past ten tonight", "morgen früh".

An hour from 1 to 12 that says neither half of the day is the next time that a clock face shows it:
"until six" at 14:00 is 18:00, at 19:00 it is 06:00 of the next day. Hours above 12, a leading zero
("06:00") and "am" or "pm" leave no choice. On a named later day it is the first such hour from
06:00 on, or as it is written before "Uhr". Parts of a day begin at fixed hours, see PARTS.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date

from llm_gateway.wishes.times.dates import date_at
from llm_gateway.wishes.times.hours import hour_at
from llm_gateway.wishes.tongue import is_morning
from llm_gateway.wishes.words import Word, text_at

PARTS = {
    "morning": 6, "frueh": 6, "morgens": 6, "noon": 12, "midday": 12, "mittag": 12, "mittags": 12,
    "lunch": 12, "lunchtime": 12, "afternoon": 12, "nachmittag": 12, "nachmittags": 12,
    "evening": 18, "abend": 18, "abends": 18, "tonight": 18, "night": 18, "nacht": 18, "nachts": 0,
    "midnight": 24, "mitternacht": 24,
}  # fmt: skip
"""The hour at which a part of the day begins."""
EXACT = {"midday", "midnight", "mittag", "mitternacht", "noon"}
"""Parts of the day that are hours."""
_DIALECT = {"friah": "frueh", "fruah": "frueh", "nammidog": "nachmittag"}
"""Parts of the day as the south writes them."""
_INTO = {("auf", "die"), ("auf", "den"), ("in", "der"), ("in", "da")}
"""Before a part of the day: "in der Früh", "auf d'Nacht"."""
_LUNCH = {"lunch", "lunchtime"}
_DAYS = {"today": 0, "heute": 0, "heut": 0, "tonight": 0, "tomorrow": 1, "morgen": 1,
         "tmr": 1, "tmrw": 1, "tomoz": 1, "uebermorgen": 2}  # fmt: skip
_WEEKDAYS = (
    ("monday", "montag"), ("tuesday", "dienstag"), ("wednesday", "mittwoch"),
    ("thursday", "donnerstag"), ("friday", "freitag"), ("saturday", "samstag"),
    ("sunday", "sonntag"),
)  # fmt: skip
_SHORT_DAYS = {"mon": 0, "mo": 0, "tue": 1, "di": 1, "wed": 2, "mi": 2, "thu": 3, "do": 3, "fri": 4,
               "fr": 4, "sat": 5, "sa": 5, "sun": 6}  # fmt: skip
"""So between a word before a day and an hour."""
_BEFORE_DAYS = {"ab", "am", "bis", "by", "from", "next", "on", "till", "until", "von"}
_PAST = {"yesterday", "gestern", "vorgestern"}
_LAST = {"last", "letzte", "letzten", "letzter", "vergangene", "vergangenen"}
_THIS = {"this", "diesen", "dieser", "diesem"}
_NOISE = {"at", "um", "the", "in", "am", "on", "this", "diesen", "dieser", "diesem",
          "ca", "circa", "about", "around", "etwa",
          "ungefaehr", "dem", "den", "zum", "zur", "gegen", "dann", "sharp", "exactly", "genau",
          "punkt", "next", "like", "so", "klock"}  # fmt: skip
_MOST_NOISE = 8
"""Words that tell nothing, one behind the other, before a time is given up."""
_LEAP = 2000
"""A year that has every date."""
_HALVES = {"am": 0, "pm": 12, "a.m": 0, "p.m": 12}


@dataclass(frozen=True, slots=True)
class Point:
    """What was said about a point in time; a part that was not said is None."""

    hour: int | None = None
    minute: int = 0
    exact: bool = False
    """Whether the hour is one of 24."""
    part: str = ""
    """Of the day: a key of PARTS."""
    days: int | None = None
    """After today."""
    weekday: int | None = None
    date: date | None = None
    of_year: tuple[int, int] | None = None
    """Month and day, in the year that comes next."""
    impossible: bool = False
    """Past, or no time that a clock shows."""
    uhr: bool = False
    """Whether "Uhr" stands behind the hour, which then is one of 24 on another day; so is 12:00,
    which is noon where nothing else is said."""
    half: str = ""
    """Of the day, as it was said: "am" or "pm"."""


def point_at(words: Sequence[Word], at: int) -> tuple[Point, int] | None:
    """The point in time that is written from word `at` on, and the word behind it."""
    found = Point()
    end = at
    here = at
    while here < min(len(words), end + _MOST_NOISE):
        step = _day(words, here, found) or _hour(words, here, found) or _part(words, here, found)
        if step is not None:
            found, here = step
            end = here
        elif _into(words, here):
            here += 2
        elif (
            words[here].text in _NOISE
            or (words[here].text == "." and _short(words, here))
            or (words[here].text == "," and _goes_on(words, here, found))
        ):
            here += 1
        else:
            break
    return None if end == at else (found, end)


def _into(words: Sequence[Word], at: int) -> bool:
    """Whether two words only lead to a part of the day."""
    part = text_at(words, at + 2)
    return (text_at(words, at), text_at(words, at + 1)) in _INTO and _DIALECT.get(
        part, part
    ) in PARTS


def names_day(words: Sequence[Word], at: int) -> bool:
    """Whether word `at` is a day's: "tomorrow"."""
    text = text_at(words, at)
    return text in _DAYS or any(text in names for names in _WEEKDAYS)


def _goes_on(words: Sequence[Word], at: int, found: Point) -> bool:
    """Whether a comma stands between a day and its date, or its hour: "Monday 10 Nov, 08:00"."""
    if found.hour is not None or (found.weekday is None and found.date is None is found.of_year):
        return False
    at += text_at(words, at + 1) in {"dem", "den", "the"}
    if found.weekday is not None and found.of_year is None and date_at(words, at + 1) is not None:
        return True
    read = hour_at(words, at + 1)
    said = [] if read is None else [word.text for word in words[at + 1 : read[3]]]
    return any(":" in text or text in {"uhr", "oclock"} for text in said)


def _short(words: Sequence[Word], at: int) -> bool:
    """Whether a full stop only ends a short form."""
    return text_at(words, at - 1) in {"ca", "a.m", "p.m"}


def _day(words: Sequence[Word], at: int, found: Point) -> tuple[Point, int] | None:
    """A named day, or a date."""
    text = words[at].text
    if text in _PAST:
        return replace(found, impossible=True, part=found.part or "noon"), at + 1
    following = text_at(words, at + 1)
    if text in _LAST and (following in PARTS or any(following in names for names in _WEEKDAYS)):
        return replace(found, impossible=True, part=found.part or "noon"), at + 2
    if (named := date_at(words, at)) is not None:
        return _dated(found, named.day, named.month, named.year), named.last
    if dated := _date(words, at):
        return replace(found, date=dated), at + 5
    for number, names in enumerate(_WEEKDAYS):
        if text in names:
            return replace(found, weekday=number), at + 1
    if text in _SHORT_DAYS and text_at(words, at - 1) in _BEFORE_DAYS:
        stop = following == "."
        if hour_at(words, at + 1 + stop) is not None:
            return replace(found, weekday=_SHORT_DAYS[text]), at + 1 + stop
    if (text, following, text_at(words, at + 2)) == ("day", "after", "tomorrow"):
        return replace(found, days=2), at + 3
    if text not in _DAYS:
        return None
    if text == "morgen" and (text_at(words, at - 1) == "am" or found.days is not None):
        # "am Morgen", "heute Morgen": a part of the day.
        return replace(found, part="frueh"), at + 1
    part = "tonight" if text == "tonight" else found.part
    return replace(found, days=_DAYS[text], part=part), at + 1


def _dated(found: Point, day: int, month: int, year: int | None) -> Point:
    """A point on a named date; impossible where no calendar has it."""
    try:
        given = date(year or _LEAP, month, day)
    except ValueError:
        return replace(found, impossible=True)
    return replace(found, of_year=(month, day)) if year is None else replace(found, date=given)


def _date(words: Sequence[Word], at: int) -> date | None:
    """2026-11-23: five words."""
    parts = [text_at(words, at + n) for n in range(5)]
    if parts[1] != "-" or parts[3] != "-" or len(parts[0]) != 4:
        return None
    try:
        return date.fromisoformat("".join(parts))
    except ValueError:
        return None


def _part(words: Sequence[Word], at: int, found: Point) -> tuple[Point, int] | None:
    """A part of the day; "noon" and "midnight" are hours, too."""
    text = _DIALECT.get(words[at].text, words[at].text)
    behind = text in {"after", "nach"} and text_at(words, at + 1) in {"midnight", "mitternacht"}
    if behind and found.hour is not None and not found.exact:
        # "Until two after midnight"; "five after midnight" may be minutes.
        return replace(found, part="nachts", impossible=found.hour >= 5), at + 2
    if text == "day" and text_at(words, at - 1) in {"mid"}:
        return None
    if text not in PARTS or (found.hour is not None and text in EXACT | _LUNCH and found.part):
        return None
    if found.hour is not None and text in _LUNCH:
        return found, at + 1
    days = 0 if text_at(words, at - 1) in _THIS and found.days is None else found.days
    return replace(found, part=text, days=days), at + 1


def _hour(words: Sequence[Word], at: int, found: Point) -> tuple[Point, int] | None:
    """An hour, with minutes or without."""
    if found.hour is not None:
        return None
    read = hour_at(words, at)
    if read is None:
        return None
    hour, minute, exact, end = read
    half = text_at(words, end)
    if half in {"a", "p"} and text_at(words, end + 1) in {".m", "m", "."}:
        marks = [text_at(words, end + n) for n in range(1, 4)]
        end += 1 + next((n for n, mark in enumerate(marks) if mark not in {".", "m"}), 3)
        half += "m"
    elif half == "am" and (
        text_at(words, end + 1) in {*PARTS, "morgen"} or not is_morning(words, end)
    ):
        half = ""  # "um 8 am Abend", "bis 8 am Tor"
    elif half in _HALVES:
        end += 1
    if half in _HALVES and 1 <= hour <= 12:
        hour, exact = hour % 12 + _HALVES[half], True
    else:
        half = ""
    if hour > 24 or minute > 59 or (hour == 24 and minute):
        return replace(found, hour=0, impossible=True), end
    noon = hour == 12 and any(":" in word.text for word in words[at:end])
    uhr = noon or any(word.text == "uhr" for word in words[at:end])
    return replace(found, hour=hour, minute=minute, exact=exact, half=half, uhr=uhr), end
