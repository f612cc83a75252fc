"""Reads when a wish ends: "until six", "till smoko at eleven", "through lunch, call it 2:30"."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from llm_gateway.wishes.times import clock
from llm_gateway.wishes.times.bounds import timed
from llm_gateway.wishes.times.when import When, ending, shared
from llm_gateway.wishes.words import Word, text_at

UNTIL = {"until", "till", "til", "untill", "unitl", "untl", "bis", "through", "thru", "upto",
          "ends", "ending", "endet"}  # fmt: skip
THROUGH = {"through", "thru"}
"""They may go through a gate, too."""
_SOMEBODY = {"we", "they", "i", "it", "you", "wir", "sie", "ich", "the"}
_EVENT = {"dem", "der", "die", "das", "zum", "zur", "feierabend", "schichtende", "schichtwechsel"}
"""Behind "bis" they begin what ends at an hour: "bis der Chef um sechs kommt"."""
_CLAUSE_ENDS = {"", ",", ".", "!", ";", ":", "kommt", "geht", "ist", "so", "da", "durch", "fertig",
                "vorbei", "weg", "wieder", "zurueck"}  # fmt: skip
_FAR = 7
"""Words behind "bis" among which the hour is said that something ends at."""
_OPENS = {"", ",", ".", "!", ";", ":"}
"""Behind an hour they end what is told of it."""
_CROWDS = {"break", "crowd", "crush", "hour", "pause", "queue", "rush", "service"}
"""Behind a part of the day they begin what ends at no known hour: "until the lunch rush ends"."""
_CLOCK = ("the", "clock")
_TELLS = {"says", "shows"}
"""Before an hour they say no more than that: "until the clock says nine"."""
_SAID_SO = (("call", "it"), ("lets", "say"), ("say",), ("sagen", "wir"), ("also", "bis"), ("also",),
            ("thats",))  # fmt: skip
"""Before an hour they say which one a part of the day is: "until lunch, say 1 pm"."""


def until_at(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """The end that is written from word `at` on."""
    if text_at(words, at) == "up" and text_at(words, at + 1) == "to":
        point = clock.point_at(words, at + 2)
        if point is not None and (timed(words, at + 2, point) or _of_part(point[0])):
            return ending(at, point[1], point[0], now)
    if text_at(words, at) not in UNTIL:
        return None
    through = text_at(words, at) in THROUGH
    begin = at + 1 + (text_at(words, at + 1) in {":", "="})  # "Until: 15:00".
    if tuple(word.text for word in words[begin : begin + 2]) == _CLOCK:
        begin += 3 if text_at(words, begin + 2) in _TELLS else 0
    point = clock.point_at(words, begin)
    if point is None and not through:  # People come "through the gate at six".
        point = _event(words, at + 1) or _told(words, at + 1)
    if point is None or (through and counts(words, at + 1, point)):
        return None  # "Robots 1 through 3".
    if point[0].hour is None and (hour := _said_so(words, point[1])) is not None:
        point = shared(hour[0], point[0]), hour[1]
    if point[0].hour is None and text_at(words, point[1]) in _CROWDS:
        return When(at, point[1] + 1, clear=False)
    whole_part = point[0].hour is None and point[0].part not in clock.EXACT
    if through and whole_part:
        return When(at, point[1], clear=False)  # A part of the day ends at no known hour.
    return ending(at, point[1], point[0], now)


def counts(words: Sequence[Word], at: int, point: tuple[clock.Point, int]) -> bool:
    """Whether nothing says that a number is an hour."""
    named = point[0].part or point[0].days is not None or point[0].weekday is not None
    return not (named or point[0].hour is None or timed(words, at, point))


def _of_part(point: clock.Point) -> bool:
    """Whether it is an hour of a part of the day: "six in the morning"."""
    return point.hour is not None and bool(point.part)


def _event(words: Sequence[Word], at: int) -> tuple[clock.Point, int] | None:
    """The hour of what ends then, from word `at` on: "we close at ten", "smoko at eleven"."""
    somebody = text_at(words, at) in _SOMEBODY
    for here in range(at + 1, min(at + _FAR, len(words))):
        lead = text_at(words, here)
        point = clock.point_at(words, here + 1) if lead in {"at", "um"} else None
        if point is not None and (point[0].hour is not None or point[0].part in clock.EXACT):
            looks = text_at(words, here - 1).startswith(("look", "watch"))
            plain = text_at(words, point[1]) in _CLAUSE_ENDS or timed(words, here + 1, point)
            named = lead == "at" or text_at(words, at) in _EVENT
            first = at + (1 if lead == "um" else 2)  # "Bis ich um elf wieder da bin".
            near = somebody and first <= here <= at + 3
            return point if near or (plain and named and not looks) else None
        if not (lead.isalpha() or lead == "-"):
            return None
    return None


def _told(words: Sequence[Word], at: int) -> tuple[clock.Point, int] | None:
    """The hour that is told right behind what ends then: "the top of the hour, 3 pm", "I'm back
    from lunch, say 1:15 pm"."""
    for here in range(at + 1, min(at + _FAR, len(words))):
        if words[here].text == ",":
            point = clock.point_at(words, here + 1)
            if point is None or not timed(words, here + 1, point):
                return _said_so(words, here)
            return point if text_at(words, point[1]) in _OPENS else None
        if not words[here].text.isalpha():
            return None
    return None


def _said_so(words: Sequence[Word], at: int) -> tuple[clock.Point, int] | None:
    """The hour that tells which part of the day was meant, from word `at` on."""
    at += text_at(words, at) == ","
    for phrase in _SAID_SO:
        if tuple(word.text for word in words[at : at + len(phrase)]) == phrase:
            begin = at + len(phrase)
            point = clock.point_at(words, begin)
            if point is None or point[0].hour is None:
                return None
            told = timed(words, begin, point) or text_at(words, point[1]) in _OPENS
            return point if told else None
    return None
