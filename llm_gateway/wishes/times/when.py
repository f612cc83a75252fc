"""A time that a wish says, made of the points on the clock that its words name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, timedelta

from llm_gateway.wishes.times import clock, doubts
from llm_gateway.wishes.times.moments import resolve
from llm_gateway.wishes.words import Word, text_at

TO = {"to", "until", "till", "til", "bis", "through", "thru", "-", "–"}
"""Between the two ends of a span."""
_LATE = {"abend", "abends", "evening", "nacht", "night", "tonight"}
_EARLY = {"frueh", "morgens", "morning"}
"""Parts of the day of which the one that follows is the next day's."""


@dataclass(frozen=True, slots=True)
class When:
    """A time as written from word `first` up to, not including, word `last`."""

    first: int
    last: int
    start: datetime | None = None
    until: datetime | None = None
    lasts: timedelta | None = None
    """For so long, from the start on."""
    clear: bool = True
    """Whether it is known which time is meant, and it is to come."""
    past: bool = False
    """Whether it lies before now: a report may name it."""
    day: date | None = None
    """The day, where nothing else is said: "today"."""
    question: str = ""
    """What to ask about it, behind the words themselves."""


def span(words: Sequence[Word], first: int, begin: int, now: datetime) -> When | None:
    """ "X to Y", of which X is written from word `begin` on."""
    one = clock.point_at(words, begin)
    if one is None or text_at(words, one[1]) not in TO | {"and", "und"}:
        return None
    two = clock.point_at(words, one[1] + 1)
    if two is None:
        return None
    start, end = one[0], two[0]
    overnight = start.exact and end.exact and (start.hour or 0) > (end.hour or 0)
    # "From 7 in the evening to 7 tomorrow morning".
    overnight |= start.part in _LATE and end.part in _EARLY
    if not (overnight or clock.names_day(words, one[1] + 1)):
        start = shared(start, end)
    return ranged(first, two[1], start, shared(end, one[0]), now)


def ranged(first: int, last: int, begin: clock.Point, end: clock.Point, now: datetime) -> When:
    """From one point to another, or what to ask about them."""
    if begin.part in _LATE and end.part in _EARLY and end.days == begin.days:
        end = replace(end, days=None)  # "Tonight from 11 till 5 in the morning".
    begin = doubts.halved(begin, end)
    if question := doubts.of_range(begin, end, now):
        return When(first, last, clear=False, question=question)
    start = resolve(begin, now, now)
    until = None if start is None else resolve(end, now, start)
    if start is not None and until is None and begin.part == end.part and begin.part in _LATE:
        # "Tonight between eleven and quarter to six".
        until = resolve(replace(end, part="", days=None), now, start)
    return When(first, last, start, until, clear=until is not None)


def starting(first: int, last: int, point: clock.Point, now: datetime) -> When:
    """From a point on, or what to ask about it."""
    if question := doubts.of_start(point, now):
        return When(first, last, clear=False, question=question)
    start = resolve(point, now, now)
    return When(first, last, start, clear=start is not None)


def ending(first: int, last: int, point: clock.Point, now: datetime) -> When:
    """Until a point, or what to ask about it."""
    if question := doubts.of_end(point, now):
        return When(first, last, clear=False, question=question)
    until = resolve(point, now, now)
    return When(first, last, until=until, clear=until is not None)


def shared(point: clock.Point, other: clock.Point) -> clock.Point:
    """A point with the day, and the part of the day, that were said of the other end."""
    days = other.days if point.days is None else point.days
    weekday = other.weekday if point.weekday is None else point.weekday
    # "From tonight at eight until tomorrow at six": an end on a day of its own.
    apart = _day_of(point) not in (_day_of(clock.Point()), _day_of(other))
    part = point.part or ("" if apart or other.part in clock.EXACT else other.part)
    return replace(
        point,
        part=part,
        days=days,
        weekday=weekday,
        date=point.date or other.date,
        of_year=point.of_year or other.of_year,
        impossible=point.impossible or other.impossible,
    )


def _day_of(point: clock.Point) -> tuple[object, ...]:
    """What was said of its day."""
    return point.days, point.weekday, point.date, point.of_year
