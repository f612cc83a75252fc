"""Reads dates with the month's name: "the 3rd of June", "March 3, 2019", "31. April"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from llm_gateway.wishes.words import Word, text_at

_MONTHS = (
    ("january", "jan", "januar", "jaenner"), ("february", "feb", "februar"),
    ("march", "maerz"), ("april", "apr"), ("may", "mai"), ("june", "juni"), ("july", "juli"),
    ("august", "aug"), ("september", "sept"), ("october", "oct", "oktober", "okt"),
    ("november", "nov"), ("december", "dec", "dezember", "dez"),
)  # fmt: skip
_DOTTED = re.compile(r"(\d{1,2})\.(\d{1,2})")
_WITH_YEAR = re.compile(r"(\d{1,2})\.(\d{1,2})\.([12]\d{3})")
_LEADS = re.compile(r"ab|am|bis|den|dem|vom|zum|(?:mon|diens|donners|frei|sams|sonn)tag|mittwoch")
"""Before two numbers with a full stop they say that these are a day and a month."""
_UNTIL = {"ab", "bis"}
"""They lead to an hour as well: in the middle of a sentence the full stop tells."""
_OF_YEAR = range(1, len(_MONTHS) + 1)
_ORDINAL = {"st", "nd", "rd", "th", "."}
_YEAR_DIGITS = 4


@dataclass(frozen=True, slots=True)
class Dated:
    """A date as it is written, up to, not including, word `last`; perhaps in no calendar."""

    day: int
    month: int
    year: int | None
    last: int


def date_at(words: Sequence[Word], at: int) -> Dated | None:
    """The date that is written from word `at` on."""
    if (dated := _dotted(words, at)) is not None:
        return dated
    day = _day(words, at)
    if day is not None:
        here = _behind(words, at + 1)
        here += text_at(words, here) == "of"
        month = _month(words, here)
        here += 1
    else:
        month, day = _month(words, at), _day(words, at + 1)
        here = _behind(words, at + 2)
    if day is None or month is None:
        return None
    bare = here - at == len(["5", "may"]) and text_at(words, at + 1) == "may"
    if bare and text_at(words, at - 1) not in {"by", "from", "on", "the", "till", "until"}:
        return None  # "Robots 2 and 5 may help".
    comma = text_at(words, here) == ","
    year = text_at(words, here + comma)
    if year.isascii() and year.isdecimal() and len(year) == _YEAR_DIGITS and year[0] in "12":
        return Dated(day, month, int(year), here + comma + 1)
    return Dated(day, month, None, here)


def _dotted(words: Sequence[Word], at: int) -> Dated | None:
    """ "Montag, 16.06.", "am 16.6.": two numbers and a full stop, where words say it is a date."""
    whole = _WITH_YEAR.fullmatch(text_at(words, at))
    if whole is not None:
        return Dated(int(whole[1]), int(whole[2]), int(whole[3]), at + 1)
    found = _DOTTED.fullmatch(text_at(words, at))
    before = text_at(words, at - 1 - (text_at(words, at - 1) == ","))
    if found is None or text_at(words, at + 1) != "." or not _LEADS.fullmatch(before):
        return None
    if before in _UNTIL and (int(found[2]) not in _OF_YEAR or not text_at(words, at + 2)):
        return None  # "Bis 18.30." ends a sentence.
    return Dated(int(found[1]), int(found[2]), None, at + 2)


def _behind(words: Sequence[Word], at: int) -> int:
    """Behind what makes an ordinal of a number."""
    return at + (text_at(words, at) in _ORDINAL)


def _day(words: Sequence[Word], at: int) -> int | None:
    text = text_at(words, at)
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= len("31") else None


def _month(words: Sequence[Word], at: int) -> int | None:
    text = text_at(words, at)
    return next((n for n, names in enumerate(_MONTHS, 1) if text in names), None)
