"""Reads when a wish begins and ends: "until six", "for three hours", "ab morgen früh".

Code does the arithmetic, in the time zone of `now`: the model never sees a clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

from llm_gateway.wishes.numbers import whole
from llm_gateway.wishes.times import clock
from llm_gateway.wishes.times.bounds import bound_at, timed
from llm_gateway.wishes.times.ends import THROUGH, UNTIL, counts, until_at
from llm_gateway.wishes.times.lengths import UNITS, length_at, with_more, with_part
from llm_gateway.wishes.times.loose import WHO, loose_at
from llm_gateway.wishes.times.when import (
    TO,
    When,
    ending,
    ranged,
    shared,
    span,
    starting,
)
from llm_gateway.wishes.words import Word, text_at

_FROM = {"from", "starting", "beginning", "ab", "von", "as", "effective", "starts"}
_SINCE = {"since", "seit", "vor", "past", "last", "letzten", "letzte", "vergangenen"}
"""Before a length of time they say that it is over."""
_REPEATED = {"every", "each", "alle", "jede", "after", "nach", "pro", "per", "schon", "bereits"}
"""Before it they say neither that it lasts so long nor from when on."""
_STARTS = {"begin", "beginn", "beginne", "beginnt", "start", "starte", "startet"}
_STOPS = {"beende", "beendet", "end", "ende", "expires", "expiry", "finish", "stop", "stopp",
          "stoppt"}  # fmt: skip
_ASKING = {"", ",", ".", "!", ";", ":", "and", "bitte", "dann", "please", "then", "und"}
"""Before a verb they say that it is wished: "start at six and stop at eight"."""
_CHOSEN = {"another", "any", "each", "every", "first", "former", "last", "latter", "new", "no",
           "old", "other", "same", "second", "that", "the", "this", "which"}  # fmt: skip
"""Before "one" they make something else of it than an hour."""
_THESE = {"diese", "diesen", "those", "these"}
"""Before a number they say the same of it: "without these two till 4 pm"."""
_FIRST_OF_ALL = {"prio", "priority", "prioritaet"}
"""Before a one they say that it is no hour."""
_GIVEN = {"der", "die", "next", "naechste", "naechsten", "naechster", "the"}
"""Behind "in" and before a length they say that it runs: "in the hour" is not "in an hour"."""
_OFF_BY = {"ago", "already", "alt", "behind", "earlier", "fast", "hinterher", "late",
           "old", "slow"}  # fmt: skip
"""Behind a length they say that it is over, or how late, fast or old something is."""
_THAT = {"that", "these", "this", "those", "diese", "dieser", "diesen", "dieses"}
_SPANS = {"period", "slot", "time", "window", "zeit", "zeitfenster", "zeitraum"}
"""Behind "for that" they point to a time that is said elsewhere."""
_OPEN = (
    ("ab", "jetzt"), ("ab", "sofort"), ("as", "of", "now"), ("at", "the", "moment"),
    ("bis", "auf", "weiteres"), ("fuer", "den", "anfang"), ("fuer", "den", "moment"),
    ("fuers", "erste"), ("for", "the", "time", "being"), ("bis", "ich", "mich", "melde"),
    ("bis", "ich", "mich", "wieder", "melde"), ("bis", "ich", "was", "anderes", "sage"),
    ("effective", "immediately"), ("for", "now"), ("for", "the", "moment"), ("from", "now", "on"),
    ("right", "now"), ("until", "further", "notice"), ("until", "further", "word"),
    ("until", "i", "say", "otherwise"), ("until", "i", "say", "so"),
    ("until", "told", "otherwise"), ("until", "you", "hear", "from", "me"),
    ("mit", "sofortiger", "wirkung"), ("von", "jetzt", "an"), ("with", "immediate", "effect"),
)  # fmt: skip
"""Say nothing about a time."""


def when_at(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """The time that is written from word `at` on."""
    opened = _open(words, at)
    if opened:
        return When(at, opened)
    return (
        bound_at(words, at, now)
        or _between(words, at, now)
        or _from(words, at, now)
        or until_at(words, at, now)
        or _ordered(words, at, now)
        or _lasting(words, at, now)
        or _bare_span(words, at, now)
        or _opening(words, at, now)
        or loose_at(words, at, now)
    )


def _open(words: Sequence[Word], at: int) -> int:
    """The word behind words that say nothing about a time; 0 where there are none."""
    for phrase in _OPEN:
        said = [word.text for word in words[at : at + len(phrase)]]
        if said[:1] in (["till"], ["til"]):
            said[0] = "until"
        if tuple(said) == phrase:
            return at + len(phrase)
    pointed = text_at(words, at) in {"for", "fuer", "in", "during", "waehrend", "over"}
    given = text_at(words, at) == "in" and text_at(words, at + 1) == "der"
    given &= text_at(words, at + 2) not in _SPANS  # "In der Zeit" may say no more than "then".
    if given or (pointed and text_at(words, at + 1) in _THAT):
        here = at + 2
        while text_at(words, here) in {"full", "ganze", "half", "halbe", "halben", "whole"}:
            here += 1
        if text_at(words, here) in _SPANS or text_at(words, here) in UNITS:
            return here + 1
    return 0


def _between(words: Sequence[Word], at: int, now: datetime) -> When | None:
    if text_at(words, at) not in {"between", "zwischen"}:
        return None
    return span(words, at, at + 1, now)


def _from(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "from five to seven", "ab 17 Uhr", "starting at three", "in ten minutes"."""
    text = text_at(words, at)
    given = text_at(words, at + 1) in _GIVEN
    if text == "in" and not given and (long := length_at(words, at + 1)) is not None:
        return When(at, long[1], start=now + long[0])
    day = clock.point_at(words, at)
    if day is not None and day[0].hour is None:
        return _on_day(words, at, day, now) or _begin(words, at, now)
    return _begin(words, at, now)


def _on_day(
    words: Sequence[Word], at: int, day: tuple[clock.Point, int], now: datetime
) -> When | None:
    """ "tomorrow from 8 am", "tonight from 20:00 to 22:00", "heute bis 13 Uhr"."""
    here = text_at(words, day[1])
    if here not in {"from", "von", "ab", "between", "zwischen"} | UNTIL:
        return None
    first = clock.point_at(words, day[1] + 1)
    if first is None:
        return None
    point = shared(first[0], day[0])
    if here in UNTIL:
        return ending(at, first[1], point, now)
    last = first[1] + (1 if text_at(words, first[1]) in {"on", "onwards", "an"} else 0)
    if text_at(words, first[1]) not in TO | {"and", "und"}:
        return starting(at, last, point, now)
    second = clock.point_at(words, first[1] + 1)
    if second is None:
        return starting(at, last, point, now)
    point = shared(point, second[0])
    return ranged(at, second[1], point, shared(second[0], point), now)


def _begin(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "from five to seven", "ab 17 Uhr", "starting at three"."""
    text = text_at(words, at)
    if text not in _FROM | {"since", "seit"}:
        return None
    begin = at + 1
    if text in {"since", "seit"}:
        point = clock.point_at(words, begin)
        return None if point is None else When(at, point[1], clear=False, past=True)
    if text_at(words, begin) in {"the", "der"} and text_at(words, begin + 2) in WHO:
        return None  # "Back from the night shift".
    if text_at(words, begin) in {"from", "of", "at", "with"}:
        begin += 1
    elif text == "as":
        return None  # "Treat both as one".
    if (both := span(words, at, begin, now)) is not None:
        return both
    point = clock.point_at(words, begin)
    if point is None:
        return None
    last = point[1] + (1 if text_at(words, point[1]) in {"on", "onwards", "an"} else 0)
    if text == "von" and last == point[1] and counts(words, begin, point):
        return None  # "Eine Gruppe von etwa zwanzig".
    if point[0].impossible and counts(words, begin, point):
        return None  # "Anything from seventy-eight up".
    return starting(at, last, point[0], now)


def _ordered(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "Start at 19:15 and stop at 20:45", "Ende 16 Uhr": what is to begin or to end then."""
    text = text_at(words, at)
    if text not in _STARTS | _STOPS or text_at(words, at - 1) not in _ASKING:
        return None
    begin = at + 1 + (text_at(words, at + 1) in {":", "=", "at", "um"})
    point = clock.point_at(words, begin)
    if point is None or (point[0].hour is None and point[0].part not in clock.EXACT):
        return None
    if begin == at + 1 and not timed(words, begin, point):
        return None
    made = starting if text in _STARTS else ending
    return made(at, point[1], point[0], now)


def _lasting(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "for three hours", "die nächsten 20 Minuten", "drei Stunden lang", "one hour"."""
    here = at
    while text_at(words, here) in {"for", "coming", "kommenden", "kommende", "during", "fuer",
    "another", "about", "so", "the", "die",
                                 "naechsten", "naechste", "next", "noch", "waehrend", "der",
                                 "circa", "ca", "etwa", "within", "dauer",
                                 "von", "duration", "of"}:  # fmt: skip
        here += 1
    long = length_at(words, here)
    next_one = (
        text_at(words, here - 1)
        in {"next", "naechste", "naechsten", "coming", "kommende", "kommenden"}
        and here > at
    )
    if long is None and next_one and text_at(words, here) in UNITS:
        long = timedelta(seconds=UNITS[text_at(words, here)]), here + 1
    if long is None:
        return None
    long = with_more(words, with_part(words, long))
    if here == at and (apart := _apart(words, at, long, now)) is not None:
        return apart
    last = long[1] + (1 if text_at(words, long[1]) in {"lang", "long"} else 0)
    off = last + (text_at(words, last) in {"too", "zu"})
    over = text_at(words, off) in _OFF_BY | ({"spaet"} if off > last else set())
    over |= [word.text for word in words[last : last + 3]] == ["on", "the", "clock"]
    over |= text_at(words, last) == "off" and text_at(words, at - 1) in {"are", "is"}
    over |= text_at(words, at - 1) == "by" and text_at(words, at - 2) == "late"
    if over or text_at(words, at - 1) in _SINCE | _REPEATED:
        past = text_at(words, at - 1) not in _REPEATED
        return When(at, off + 1 if over else last, clear=False, past=past)
    return When(at, last, lasts=long[0])


def _apart(
    words: Sequence[Word], at: int, long: tuple[timedelta, int], now: datetime
) -> When | None:
    """ "Two hours from now", "two hours later", "ten minutes after six": how far off a time is."""
    lasts, end = long
    behind = text_at(words, end)
    until = text_at(words, at - 1) in UNTIL
    if behind == "from" and text_at(words, end + 1) == "now":
        if until:
            return When(at - 1, end + 2, until=now + lasts)
        return When(at, end + 2, start=now + lasts)
    if behind in {"later", "spaeter"}:
        return When(at, end + 1, clear=False)  # Than now, or than something else.
    point = clock.point_at(words, end + 1) if behind in {"after", "before", "nach", "vor"} else None
    if point is None or (point[0].hour is None and point[0].part not in clock.EXACT):
        return None
    return When(at, point[1], clear=False)


def _bare_span(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "22:00 bis 04:00", "7 am to noon": one end at least is plainly a clock's."""
    one = clock.point_at(words, at)
    if one is None or text_at(words, one[1]) not in TO or text_at(words, at) in {"since", "seit"}:
        return None
    number, before = text_at(words, one[1] - 1), text_at(words, one[1] - 2)
    if before in _THESE and one[1] == at + 1:
        return None
    if whole(number) == 1 and before in (_CHOSEN if number == "one" else _FIRST_OF_ALL):
        return None  # "Prio 1 bis 6:30", "lower that one until two pm".
    two = clock.point_at(words, one[1] + 1)
    if two is None or not (timed(words, at, one) or timed(words, one[1] + 1, two)):
        return None
    if text_at(words, one[1]) in THROUGH and counts(words, one[1] + 1, two):
        return None  # "At 17:15 through two gates".
    if any(point.hour is None and point.part not in clock.EXACT for point in (one[0], two[0])):
        return None
    return span(words, at, at, now)


def _opening(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "at midnight and keep it until six", "at 10:30 for two hours": it begins then."""
    if text_at(words, at) not in {"at", "um"}:
        return None
    point = clock.point_at(words, at + 1)
    if point is None or (point[0].hour is None and point[0].part not in clock.EXACT):
        return None
    here = point[1]
    while text_at(words, here) in {"and", "und", ",", "keep", "it", "that", "them", "go", "then",
                                   "stay", "stays", "bleibt", "bleiben"}:  # fmt: skip
        here += 1
    lasts = text_at(words, here) in {"for", "fuer"} and _lasting(words, here, now)
    return starting(at, point[1], point[0], now) if lasts or until_at(words, here, now) else None


LEFT = frozenset(
    """until till til hour hours hrs minute minutes mins stunde stunden std stuendchen stund stond
    stuendli stuenderl viertelstund viertelstuendli dreiviertelstund viertelstunde
    viertelstunden dreiviertelstunde dreiviertelstunden halbstunde halbstunden minuten sekunden uhr
    oclock tomorrow tonight today week weeks month woche wochen monat heute feierabend weekend
    wochenende""".split()
)
"""Words that tell a time: where none of it was read, it is unclear."""
