"""What to ask where the time that was said is over: "8 to 10 today" at 13:10.

A clock face shows 8 twice a day. What was said before noon may be meant for the evening, for
tomorrow, or late; only the person knows. "am", "abends", "tonight" and 20:00 leave no doubt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta

from llm_gateway.wishes.times.clock import Point
from llm_gateway.wishes.times.moments import resolve

_HALF = timedelta(hours=12)
_BEGUN = timedelta(hours=1)
"""A beginning that has just gone by may be meant for now."""
_NOON = 12
_EVENING = 18


def halved(start: Point, until: Point) -> Point:
    """The start of a range in the half of the day that its end leaves: "8 to 10 pm" begins at
    20:00, "11 to 2 pm" and "8 bis 17 Uhr" before noon."""
    if not _on_a_face(start) or start.hour is None:
        return start
    if until.hour is None:
        noon = until.part in {"noon", "midday", "mittag"} and start.hour < _NOON
        return replace(start, exact=True) if noon else start
    if until.half:
        hour = start.hour % 12 + (12 if until.hour >= 12 else 0)
        if (hour, start.minute) >= (until.hour, until.minute):
            hour = (hour + 12) % 24
        return replace(start, hour=hour, exact=True)
    if until.hour > 12 and start.hour < until.hour <= start.hour + 12:
        return replace(start, exact=True)
    return start


def of_range(start: Point, until: Point, now: datetime) -> str:
    """What to ask about a range; empty: it is plain which one is meant."""
    said = _written(start, now)
    end = None if said is None else resolve(_any_day(until), now, said)
    if said is None or end is None or said > now:
        return ""
    if _on_a_face(start) and said + _HALF <= now < end + _HALF:
        options = [f"until {end + _HALF:%H:%M}", _from_to("tomorrow", said + 2 * _HALF, until)]
        return _question("has begun", options, now)
    if not _doubtful(start, said, now) and (_on_a_face(start) or now >= end):
        return ""
    runs = now < end
    later = said + _HALF
    options = [f"until {end:%H:%M}"] if runs else []
    if _on_a_face(start) and later > now:
        options.append(_from_to(_part(later, now), later, until))
    options.append(_from_to("tomorrow", said + timedelta(days=1), until))
    return _question("has begun" if runs else "is over", options, now)


def of_start(point: Point, now: datetime) -> str:
    """What to ask about a beginning without an end; empty: it is plain."""
    said = _written(point, now)
    if said is None or said > now:
        return ""
    begun = said + _HALF if _on_a_face(point) else said
    if point.days is None and begun <= now < begun + _BEGUN:
        options = ["from now on", f"tomorrow from {said:%H:%M} on"]
        return _question("is over", options, now)
    if not _doubtful(point, said, now):
        return ""
    options = ["from now on"]
    if said + _HALF > now:
        options.append(f"{_part(said + _HALF, now)} from {said + _HALF:%H:%M} on")
    return _question("is over", [*options, f"tomorrow from {said:%H:%M} on"], now)


def of_end(point: Point, now: datetime) -> str:
    """What to ask about an end; empty: it is plain. Without a day it is the next one."""
    said = _written(point, now)
    if said is None or said > now or point.days is None or not _on_a_face(point):
        return ""
    options = [f"until {said + _HALF:%H:%M}"] if said + _HALF > now else []
    return _question("is over", [*options, f"until tomorrow {said:%H:%M}"], now)


def _doubtful(point: Point, said: datetime, now: datetime) -> bool:
    """Whether a time that is over may be another one. Without a day the next one is meant where
    that is nearer."""
    if not _on_a_face(point):
        return False
    return point.days == 0 or said + _HALF - now > now - said


def _written(point: Point, now: datetime) -> datetime | None:
    """An hour of today or of no day as it is written, on a clock of 24 hours; None where other
    words say which one is meant."""
    if point.hour is None or point.part or point.impossible or point.days:
        return None
    if any(day is not None for day in (point.weekday, point.date, point.of_year)):
        return None
    today = now.replace(hour=0, minute=0, second=0, microsecond=0)
    return today + timedelta(hours=point.hour, minutes=point.minute)


def _on_a_face(point: Point) -> bool:
    return not point.exact and not point.part and point.hour is not None and 1 <= point.hour <= 12


def _any_day(point: Point) -> Point:
    return replace(point, days=None)


def _part(time: datetime, now: datetime) -> str:
    if time.date() > now.date():
        return "tonight"
    return "this evening" if time.hour >= _EVENING else "this afternoon"


def _from_to(day: str, start: datetime, until: Point) -> str:
    end = resolve(_any_day(until), start, start)
    return f"{day} {start:%H:%M}" + ("" if end is None else f" to {end:%H:%M}")


def _question(what: str, options: Sequence[str], now: datetime) -> str:
    return f"{what} at {now:%H:%M}: {', or '.join(options)}?"
