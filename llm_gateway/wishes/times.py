"""Reads when a wish begins and ends: "until six", "for three hours", "ab morgen früh".

Code does the arithmetic, in the time zone of `now`: the model never sees a clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

from llm_gateway.wishes import clock, doubts
from llm_gateway.wishes.lengths import UNITS, length_at
from llm_gateway.wishes.moments import resolve
from llm_gateway.wishes.words import Word

_UNTIL = {"until", "till", "til", "untill", "unitl", "untl", "bis", "through", "upto", "ends",
          "ending",
          "endet"}  # fmt: skip
_FROM = {"from", "starting", "beginning", "ab", "von", "as", "effective", "starts"}
_SINCE = {"since", "seit", "vor", "past", "last", "letzten", "letzte", "vergangenen"}
"""Before a length of time they say that it is over."""
_LATE = {"tonight", "night", "nacht", "evening", "abend", "abends"}
"""Once begun, they go on."""
_REPEATED = {"every", "each", "alle", "jede", "after", "nach", "pro", "per"}
"""Before it they say neither that it lasts so long nor from when on."""
_WHO = {"crew", "shift", "team", "staff", "desk", "supervisor", "manager", "lead", "porter", "duty",
        "schicht", "schichtleitung", "dienst", "mannschaft"}  # fmt: skip
"""Beside a part of the day they tell who speaks, or of whom."""
_EXACT = {"noon", "midday", "midnight", "mittag", "mitternacht"}
_SOMEBODY = {"we", "they", "i", "it", "you", "wir", "sie", "ich", "the"}
_TO = {"to", "until", "till", "til", "bis", "-", "–"}
_OPEN = (
    ("until", "further", "notice"), ("bis", "auf", "weiteres"), ("from", "now", "on"),
    ("ab", "sofort"), ("ab", "jetzt"), ("for", "now"), ("right", "now"), ("effective",
    "immediately"),
    ("as", "of", "now"), ("von", "jetzt", "an"), ("until", "i", "say", "otherwise"), ("till", "i",
    "say", "otherwise"),
    ("until", "i", "say", "so"), ("bis", "ich", "mich", "wieder", "melde"),
    ("bis", "ich", "mich", "melde"), ("bis", "ich", "was", "anderes", "sage"),
    ("for", "the", "moment"), ("at", "the", "moment"),
)  # fmt: skip
"""Say nothing about a time."""


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
    question: str = ""
    """What to ask about it, behind the words themselves."""


def when_at(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """The time that is written from word `at` on."""
    for phrase in _OPEN:
        if tuple(word.text for word in words[at : at + len(phrase)]) == phrase:
            return When(at, at + len(phrase))
    return (
        _between(words, at, now)
        or _from(words, at, now)
        or _until(words, at, now)
        or _lasting(words, at, now)
        or _bare_span(words, at, now)
        or _opening(words, at, now)
        or _loose(words, at, now)
    )


def _text(words: Sequence[Word], at: int) -> str:
    return words[at].text if 0 <= at < len(words) else ""


def _span(words: Sequence[Word], first: int, begin: int, now: datetime) -> When | None:
    """ "X to Y", of which X is written from word `begin` on."""
    one = clock.point_at(words, begin)
    if one is None or _text(words, one[1]) not in _TO | {"and", "und"}:
        return None
    two = clock.point_at(words, one[1] + 1)
    if two is None:
        return None
    start, end = one[0], two[0]
    overnight = start.exact and end.exact and (start.hour or 0) > (end.hour or 0)
    if not (overnight or clock.names_day(words, one[1] + 1)):
        start = _shared(start, end)
    return _ranged(first, two[1], start, _shared(end, one[0]), now)


def _ranged(first: int, last: int, begin: clock.Point, end: clock.Point, now: datetime) -> When:
    begin = doubts.halved(begin, end)
    if question := doubts.of_range(begin, end, now):
        return When(first, last, clear=False, question=question)
    start = resolve(begin, now, now)
    until = None if start is None else resolve(end, now, start)
    return When(first, last, start, until, clear=until is not None)


def _starting(first: int, last: int, point: clock.Point, now: datetime) -> When:
    if question := doubts.of_start(point, now):
        return When(first, last, clear=False, question=question)
    start = resolve(point, now, now)
    return When(first, last, start, clear=start is not None)


def _ending(first: int, last: int, point: clock.Point, now: datetime) -> When:
    if question := doubts.of_end(point, now):
        return When(first, last, clear=False, question=question)
    until = resolve(point, now, now)
    return When(first, last, until=until, clear=until is not None)


def _shared(point: clock.Point, other: clock.Point) -> clock.Point:
    """A point with the day, and the part of the day, that were said of the other end."""
    days = other.days if point.days is None else point.days
    weekday = other.weekday if point.weekday is None else point.weekday
    part = point.part or ("" if other.part in {"midnight", "noon", "mitternacht"} else other.part)
    return replace(
        point,
        part=part,
        days=days,
        weekday=weekday,
        date=point.date or other.date,
        impossible=point.impossible or other.impossible,
    )


def _between(words: Sequence[Word], at: int, now: datetime) -> When | None:
    if _text(words, at) not in {"between", "zwischen"}:
        return None
    return _span(words, at, at + 1, now)


def _from(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "from five to seven", "ab 17 Uhr", "starting at three", "in ten minutes"."""
    text = _text(words, at)
    if text == "in" and (long := length_at(words, at + 1)) is not None:
        return When(at, long[1], start=now + long[0])
    day = clock.point_at(words, at)
    if day is not None and day[0].hour is None:
        return _on_day(words, at, day, now) or _begin(words, at, now)
    return _begin(words, at, now)


def _on_day(
    words: Sequence[Word], at: int, day: tuple[clock.Point, int], now: datetime
) -> When | None:
    """ "tomorrow from 8 am", "tonight from 20:00 to 22:00", "heute bis 13 Uhr"."""
    here = _text(words, day[1])
    if here not in {"from", "von", "ab", "between", "zwischen"} | _UNTIL:
        return None
    first = clock.point_at(words, day[1] + 1)
    if first is None:
        return None
    point = _shared(first[0], day[0])
    if here in _UNTIL:
        return _ending(at, first[1], point, now)
    last = first[1] + (1 if _text(words, first[1]) in {"on", "onwards", "an"} else 0)
    if _text(words, first[1]) not in _TO | {"and", "und"}:
        return _starting(at, last, point, now)
    second = clock.point_at(words, first[1] + 1)
    if second is None:
        return _starting(at, last, point, now)
    point = _shared(first[0], _shared(second[0], day[0]))
    return _ranged(at, second[1], point, _shared(second[0], point), now)


def _begin(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "from five to seven", "ab 17 Uhr", "starting at three"."""
    text = _text(words, at)
    if text not in _FROM | {"since", "seit"}:
        return None
    begin = at + 1
    if text in {"since", "seit"}:
        point = clock.point_at(words, begin)
        return None if point is None else When(at, point[1], clear=False, past=True)
    if _text(words, begin) in {"from", "of", "at", "with"}:
        begin += 1
    if (span := _span(words, at, begin, now)) is not None:
        return span
    point = clock.point_at(words, begin)
    if point is None:
        return None
    last = point[1] + (1 if _text(words, point[1]) in {"on", "onwards", "an"} else 0)
    return _starting(at, last, point[0], now)


def _until(words: Sequence[Word], at: int, now: datetime) -> When | None:
    if _text(words, at) == "up" and _text(words, at + 1) == "to":
        point = clock.point_at(words, at + 2)
        if point is not None and _timed(words, at + 2, point):
            return _ending(at, point[1], point[0], now)
    if _text(words, at) not in _UNTIL:
        return None
    point = clock.point_at(words, at + 1)
    for here in range(at + 3, min(at + 5, len(words))):
        # "until we close at ten".
        if (
            point is None
            and _text(words, at + 1) in _SOMEBODY
            and _text(words, here) in {"at", "um"}
        ):
            point = clock.point_at(words, here + 1)
    if point is None:
        return None
    return _ending(at, point[1], point[0], now)


def _lasting(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "for three hours", "die nächsten 20 Minuten", "drei Stunden lang", "one hour"."""
    here = at
    while _text(words, here) in {"for", "coming", "kommenden", "kommende", "during", "fuer",
    "another", "about", "so", "the", "die",
                                 "naechsten", "naechste", "next", "noch", "waehrend", "der",
                                 "circa", "ca", "etwa", "within", "dauer",
                                 "von", "duration", "of"}:  # fmt: skip
        here += 1
    long = length_at(words, here)
    next_one = (
        _text(words, here - 1) in {"next", "naechste", "naechsten", "coming", "kommende"}
        and here > at
    )
    if long is None and next_one and _text(words, here) in UNITS:
        long = timedelta(seconds=UNITS[_text(words, here)]), here + 1
    if long is None:
        return None
    if next_one and [word.text for word in words[long[1] : long[1] + 3]] == ["and", "a", "half"]:
        long = long[0] * 1.5, long[1] + 3
    last = long[1] + (1 if _text(words, long[1]) in {"lang", "long"} else 0)
    if _text(words, last) in {"ago", "earlier"} or _text(words, at - 1) in _SINCE | _REPEATED:
        past = _text(words, at - 1) not in _REPEATED
        end = last + (1 if _text(words, last) in {"ago", "earlier"} else 0)
        return When(at, end, clear=False, past=past)
    return When(at, last, lasts=long[0])


def _bare_span(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "22:00 bis 04:00", "7 am to noon": one end at least is plainly a clock's."""
    one = clock.point_at(words, at)
    if one is None or _text(words, one[1]) not in _TO or _text(words, at) in {"since", "seit"}:
        return None
    two = clock.point_at(words, one[1] + 1)
    if two is None or not (_timed(words, at, one) or _timed(words, one[1] + 1, two)):
        return None
    if any(point.hour is None and point.part not in _EXACT for point in (one[0], two[0])):
        return None
    return _span(words, at, at, now)


def _timed(words: Sequence[Word], at: int, point: tuple[clock.Point, int]) -> bool:
    """Whether words say that a number, or a part of the day, is an hour."""
    said = [word.text for word in words[at : point[1]]]
    marked = {"uhr", "oclock", "am", "pm", "hrs"} & {*said}
    return bool(marked or point[0].half) or any(":" in text or text in _EXACT for text in said)


def _opening(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "at midnight and keep it until six", "at 10:30 for two hours": it begins then."""
    if _text(words, at) not in {"at", "um"}:
        return None
    point = clock.point_at(words, at + 1)
    if point is None or (point[0].hour is None and point[0].part not in _EXACT):
        return None
    here = point[1]
    while _text(words, here) in {"and", "und", ",", "keep", "it", "that", "them", "go", "then"}:
        here += 1
    lasts = _text(words, here) in {"for", "fuer"} and _lasting(words, here, now)
    return _starting(at, point[1], point[0], now) if lasts or _until(words, here, now) else None


def _loose(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """A time that stands alone says neither beginning nor end: "today", "at five", "um 17 Uhr"."""
    text = _text(words, at)
    if _text(words, at - 1) in {"good", "guten", "gute", "schoenen", "happy"}:
        return None
    first = at + (text in {"the", "this", "our", "die", "der"})
    if (
        _text(words, first) in clock.PARTS
        and {_text(words, at - 1), _text(words, first + 1)} & _WHO
    ):
        return None
    begin = at + 1 if text in {"at", "um", "am", "on", "by", "this", "gegen", "after", "nach",
                               "before", "vor"} else at  # fmt: skip
    point = clock.point_at(words, begin)
    if point is None:
        return None
    named = point[0].part or point[0].days is not None or point[0].weekday is not None
    clocked = point[0].exact or any(
        word.text in {"uhr", "oclock", "am", "pm"} for word in words[begin : point[1]]
    )
    timed = ":" in _text(words, begin) or (text in {"at", "um"} and point[0].hour is not None)
    if not (named or timed or (clocked and begin < point[1] - 1)):
        return None
    past = point[0].impossible or (point[0].days == 0 and resolve(point[0], now, now) is None)
    over = past and point[0].part not in {"", *_LATE}
    return When(at, point[1], clear=False, past=over)


LEFT = frozenset(
    """until till til hour hours minute minutes stunde stunden minuten uhr oclock tomorrow tonight
    today week weeks month woche wochen monat heute feierabend weekend wochenende""".split()  # noqa: SIM905
)
"""Words that tell a time: where none of it was read, it is unclear."""
