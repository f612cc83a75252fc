"""Reads times by their neighbours: "after 6 pm", "nobody before six", "from then on"."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from llm_gateway.wishes.cues.common import NOT
from llm_gateway.wishes.times import clock
from llm_gateway.wishes.times.hours import MILITARY
from llm_gateway.wishes.times.when import TO, When, ending, ranged, shared, starting
from llm_gateway.wishes.words import Word, text_at

_NOBODY = {"nobody", "none", "niemand", "niemanden", "noone", "without", "ohne"}
_FAR = 8
"""Words before "before" among which somebody is left out."""
_BEFORE = 40
"""Words before "then" among which its hour was said."""
_ASKED = {"anfragen", "ansprechen", "einplanen", "einsetzen", "fragen", "mitnehmen", "nehmen",
          "nutzen", "stoeren", "verwenden"}  # fmt: skip
"""Behind "nicht vor acht" they say of whom it is told that he is left out until then."""
_LEADS = {"ab", "around", "at", "begin", "begins", "by", "from", "gegen", "starting", "starts",
          "um", "von"}  # fmt: skip
"""Before an hour that is meant by "then"."""


def bound_at(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """The time that is written from word `at` on, if one of these words opens it."""
    return (
        _then(words, at, now)
        or _before(words, at, now)
        or _after(words, at, now)
        or _again(words, at, now)
    )


def timed(words: Sequence[Word], at: int, point: tuple[clock.Point, int]) -> bool:
    """Whether words say that a number, or a part of the day, is an hour."""
    said = [word.text for word in words[at : point[1]]]
    marked = {"uhr", "oclock", "am", "pm", "hrs", "past"} & {*said}
    military = any(MILITARY.fullmatch(text) for text in said)
    colon = any(":" in text or text in clock.EXACT for text in said)
    return bool(marked or point[0].half) or colon or military


def _then(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "from then on", "ab dann", "from then until 18:00": from the hour that was said before."""
    until = text_at(words, at) in {"bis", "til", "till", "until"}
    if not until and text_at(words, at) not in {"from", "ab", "von"}:
        return None
    until_then = {"dahin", "dann", "then"}
    if text_at(words, at + 1) == "dann" and not text_at(words, at + 2).isalpha():
        until_then = {"dahin"}  # "Bis dann!" says goodbye.
    if text_at(words, at + 1) not in (until_then if until else {"then", "dann", "da", "there"}):
        return None
    point = _said(words, at)
    if point is None:
        return None
    if until:
        return ending(at, at + 2, point, now)
    last = at + 2 + (text_at(words, at + 2) in {"on", "onwards", "an"})
    end = clock.point_at(words, last + 1) if text_at(words, last) in TO else None
    if end is not None:
        return ranged(at, end[1], point, end[0], now)
    return starting(at, last, point, now)


def _said(words: Sequence[Word], at: int) -> clock.Point | None:
    """The last hour before a word."""
    for begin in range(at - 1, max(-1, at - _BEFORE), -1):
        point = clock.point_at(words, begin)
        if point is None or point[0].hour is None or point[1] > at:
            continue
        led = text_at(words, begin - 1) in _LEADS or text_at(words, begin) in clock.PARTS
        if led or timed(words, begin, point):
            day = clock.point_at(words, begin - 2) if clock.names_day(words, begin - 2) else None
            return point[0] if day is None else shared(point[0], day[0])
    return None


def _before(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "nobody is asked before six": until then. "Not before six" alone may be a beginning."""
    if text_at(words, at) not in {"before", "vor"}:
        return None
    point = clock.point_at(words, at + 1)
    near = [word.text for word in words[max(0, at - _FAR) : at]]
    exact = point is not None and point[0].part in clock.EXACT
    if point is None or (point[0].hour is None and not exact) or not near:
        return None
    left_out = bool({*near} & _NOBODY or NOT.search(" ".join(near)))
    turned = bool(NOT.fullmatch(near[-1]))
    if left_out and (not turned or text_at(words, point[1]) in _ASKED):
        return ending(at, point[1], point[0], now)
    plain = timed(words, at + 1, point) or text_at(words, point[1]) in {"", ",", ".", "!", ";"}
    return When(at, point[1], clear=False) if plain or turned else None


def _after(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "after 6 pm": from then on."""
    if text_at(words, at) not in {"after", "nach"}:
        return None
    point = clock.point_at(words, at + 1)
    if point is None or (point[0].hour is None and point[0].part not in clock.EXACT):
        return None
    plain = timed(words, at + 1, point) or words[at + 1].text.isalpha()
    return starting(at, point[1], point[0], now) if plain else None


def _again(words: Sequence[Word], at: int, now: datetime) -> When | None:
    """ "R5 erst ab morgen um acht wieder fragen": until then nobody asks it."""
    if text_at(words, at) not in {"ab", "um"} or text_at(words, at - 1) != "erst":
        return None
    point = clock.point_at(words, at + 1)
    if point is None or text_at(words, point[1]) != "wieder":
        return None
    asked = text_at(words, point[1] + 1) in _ASKED
    return ending(at, point[1], point[0], now) if asked else None
