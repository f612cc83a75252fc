"""Reads times that stand alone, of which nobody knows what begins or ends then: "today"."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.times import clock
from llm_gateway.wishes.times.dates import date_at
from llm_gateway.wishes.times.moments import resolve
from llm_gateway.wishes.times.when import When
from llm_gateway.wishes.words import Word, text_at

_LATE = {"tonight", "night", "nacht", "evening", "abend", "abends"}
"""Once begun, they go on."""
WHO = {"crew", "shift", "team", "staff", "desk", "supervisor", "manager", "lead", "porter", "duty",
        "schicht", "schichtleitung", "dienst", "mannschaft"}  # fmt: skip
"""Beside a part of the day they tell who speaks, or of whom."""
_MEALS = {"lunch", "lunchtime"}
"""Before a noun they tell of what kind it is."""
_AT_LUNCH = [["to", "away"], ["to", "gone"], ["to", "off"], ["to", "out"], ["to", "went"]]
_GREETED = {"!", ",", "all", "everybody", "everyone", "folks", "guys", "leute", "mate",
            "miteinander", "mitenand", "team", "together", "zusammen"}  # fmt: skip
"""Behind a part of the day that opens a wish they say that it greets: "Morning all"."""


def loose_at(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """A time that stands alone says neither beginning nor end: "today", "at five", "um 17 Uhr"."""
    text = text_at(words, at)
    before = [text_at(words, at - 1), text_at(words, at - 2)]
    if text in _MEALS and (before in _AT_LUNCH or before[0] in {"mit", "serving", "with"}):
        return None
    if text_at(words, at - 1) in {"good", "guten", "gute", "schoenen", "happy"}:
        return None
    first = at + (text in {"the", "this", "our", "die", "der"})
    if (
        text_at(words, first) in clock.PARTS
        and {text_at(words, at - 1), text_at(words, first + 1)} & WHO
    ):
        return None
    begin = at + 1 if text in {"at", "um", "am", "on", "by", "this", "gegen", "after", "nach",
                               "before", "vor"} else at  # fmt: skip
    point = clock.point_at(words, begin)
    if point is None:
        return None
    behind = text_at(words, point[1])
    kind = point[1] - at <= len(["the", "lunch"]) and text_at(words, point[1] - 1) in _MEALS
    if kind and behind.isalpha() and not known(behind):
        return None  # "The lunch trays".
    told = {
        text_at(words, at - 1),
        text_at(words, at - 2) if text_at(words, at - 1) == "the" else "",
    }
    if text_at(words, at - 1) in {"a", "an", "einem"} and point[0].hour is None:
        return None  # "As quiet as a church on a Monday".
    if told & {"its", "is", "ist"} and point[0].hour is None:
        return None  # "It's the Saturday before Christmas".
    if first == 0 and point[0].hour is None and text_at(words, point[1]) in _GREETED:
        return None
    named = (
        bool(point[0].part)
        or date_at(words, begin) is not None
        or any(
            part is not None
            for part in (point[0].days, point[0].weekday, point[0].date, point[0].of_year)
        )
    )
    clocked = point[0].exact or any(
        word.text in {"uhr", "oclock", "am", "pm"} for word in words[begin : point[1]]
    )
    said = {word.text for word in words[begin : point[1]]}
    told_by_a_clock = said & {"half", "quarter", "viertel"} and said & {"past", "to", "nach", "vor"}
    timed = ":" in text_at(words, begin) or (text in {"at", "um"} and point[0].hour is not None)
    if not (named or timed or told_by_a_clock or (clocked and begin < point[1] - 1)):
        return None
    past = point[0].impossible or (point[0].days == 0 and resolve(point[0], now, now) is None)
    over = past and point[0].part not in {"", *_LATE}
    only_day = point[0].days is not None and point[0].hour is None and not point[0].part
    day = now.date() + timedelta(days=point[0].days or 0) if only_day else None
    return When(at, point[1], clear=False, past=over, day=day)
