"""The moment that a point in time stands for."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

from llm_gateway.wishes.times.clock import PARTS, Point

_YEARS = 9
"""In so many there is every date once, the 29th of February too."""
_RECENT = timedelta(days=183)


def resolve(point: Point, now: datetime, after: datetime) -> datetime | None:
    """The time that is meant, later than `after`; None where there is none, or several.

    `now` says what today is, and the time zone.
    """
    if point.impossible or (point.hour is None and not point.part):
        return None
    hours = _hours(point)
    today = datetime(now.year, now.month, now.day, tzinfo=now.tzinfo)
    if point.of_year is not None:
        month, of_month = point.of_year
        years = (now.year + n for n in range(-1, _YEARS))
        dated = [_midnight(now, year, month, of_month) for year in years]
        there = [day for day in dated if day is not None]
        # What just was is meant rather than its next year's.
        meant = [day for day in there if today - _RECENT < day <= today] or there
        for day in meant:
            time = _first(_morning_first(_on(day, hours, point.minute)), after)
            if time is not None:
                return time if point.weekday in (None, day.weekday()) else None
        return None
    if point.date is not None:
        day = datetime(point.date.year, point.date.month, point.date.day, tzinfo=now.tzinfo)
        return _first(_morning_first(_on(day, hours, point.minute)), after)
    if point.weekday is not None:
        day = today + timedelta(days=(point.weekday - today.weekday()) % 7)
        face = _on(day, hours, point.minute)
        best = _first(_morning_first(face), after)
        if best is not None and day == today and best != face[0]:
            return None  # "Monday 10:00", said on a Monday at 14:00: nobody knows which one.
        later = _on(day + timedelta(days=7), hours, point.minute)
        return best or _first(_morning_first(later), after)
    if point.days:
        day = today + timedelta(days=point.days)
        return _first(_morning_first(_on(day, hours, point.minute)), after)
    if point.days == 0:
        # The night goes on after midnight: "tonight at one", "until midnight".
        night = _on(today, hours, point.minute)
        if point.part in {"tonight", "night", "nacht"} and hours[0] < 8:
            night = _on(today + timedelta(days=1), hours, point.minute)
        return _first(night, after)
    days = (today + timedelta(days=n) for n in range(3))
    return _first([time for day in days for time in _on(day, hours, point.minute)], after)


def _midnight(now: datetime, year: int, month: int, day: int) -> datetime | None:
    """The beginning of a date; None in a year that does not have it."""
    try:
        return datetime(year, month, day, tzinfo=now.tzinfo)
    except ValueError:
        return None


def _hours(point: Point) -> list[int]:
    """The hours of 24 that a point may mean."""
    if point.hour is None:
        return [PARTS[point.part]]
    dated = point.date is not None or point.of_year is not None
    on_another_day = point.days or point.weekday is not None or dated
    as_written = point.uhr and on_another_day and not point.part
    if point.exact or point.hour > 12 or point.hour == 0 or as_written:
        return [point.hour]
    early, late = point.hour % 12, point.hour % 12 + 12
    match point.part:
        case "morning" | "frueh" | "morgens":
            return [early]
        case "nachts":
            # "Zehn Uhr nachts" is before midnight; from six to eight it is no night.
            return [] if early in range(6, 9) else [late if early > 8 else early]
        case "noon" | "midday" | "mittag" | "mittags" | "lunch" | "lunchtime" if early > 8:
            return [early]
        case "night" | "nacht" if point.hour in range(5, 8):
            return [early]  # "Heut Nacht bis fünf".
        case "tonight" | "night" | "nacht":
            return [late] if point.hour in range(5, 12) else [early if early else 24]
        case "" if point.uhr and point.hour == 12:
            return [12]
        case "":
            return [early, late]
        case _:
            return [late]


def _on(day: datetime, hours: Sequence[int], minute: int) -> list[datetime]:
    """On the wall clock of a day; 24 is the next day's midnight."""
    return [
        (day + timedelta(days=hour // 24)).replace(hour=hour % 24, minute=minute) for hour in hours
    ]


def _morning_first(times: list[datetime]) -> list[datetime]:
    return sorted(times, key=lambda time: time.hour < 6) if len(times) > 1 else times


def _first(times: Sequence[datetime], after: datetime) -> datetime | None:
    return next((time for time in times if time > after), None)
