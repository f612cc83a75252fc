"""Reads numbers as people write them: "half", "at least 90 percent", "zwei Drittel", "0,75"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from llm_gateway.wishes.words import Word, text_at

_ENGLISH = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen "
    "sixteen seventeen eighteen nineteen twenty"
)
_GERMAN = (
    "null eins zwei drei vier fuenf sechs sieben acht neun zehn elf zwoelf dreizehn vierzehn "
    "fuenfzehn sechzehn siebzehn achtzehn neunzehn zwanzig"
)
_TENS = {
    "thirty": 30, "forty": 40, "fifty": 50, "sixty": 60, "seventy": 70, "eighty": 80, "ninety": 90,
    "hundred": 100, "dreissig": 30, "vierzig": 40, "fuenfzig": 50, "sechzig": 60, "siebzig": 70,
    "achtzig": 80, "neunzig": 90, "hundert": 100,
}  # fmt: skip
_UNITS = {text: n for line in (_ENGLISH, _GERMAN) for n, text in enumerate(line.split())}
NAMED = _UNITS | _TENS | {"zwo": 2, "sechse": 6, "siebene": 7, "achte": 8, "neune": 9, "fuenfe": 5}
_GERMAN_TENS = re.compile(
    r"(ein|zwei|drei|vier|fuenf|sechs|sieben|acht|neun)und(zwanzig|\w+ssig|\w+zig)"
)
_ONE = {"a", "an", "one", "the", "ein", "eine", "einen", "einem", "einer", "der", "die", "das"}
_PARTS = {
    "half": 2, "halves": 2, "halfs": 2, "haelfte": 2, "halbe": 2, "halben": 2, "halb": 2,
    "halber": 2, "halbes": 2, "third": 3, "thirds": 3, "drittel": 3, "quarter": 4, "quarters": 4,
    "viertel": 4, "fifth": 5, "fifths": 5, "fuenftel": 5, "tenth": 10, "tenths": 10, "zehntel": 10,
}  # fmt: skip
_PERCENT = {"%", "percent", "pct", "prozent", "perc", "percents", "procent"}

QUALITY = re.compile(
    r"(?:min|mindest|minimal)?(?:genauigk|guete|qualit)\w*|accuracy|precision|q|qmin"
)
"""What a number bounds, with a slip at its end, too: "Mindestqualitt"."""


@dataclass(frozen=True, slots=True)
class Share:
    """A part of something, as written from word `first` up to, not including, word `last`."""

    first: int
    last: int
    value: float
    """As said: 0.9 of "90 percent", 1.5 of "150 percent"."""

    @property
    def possible(self) -> bool:
        """Whether it is a part of a whole."""
        return 0 < self.value <= 1


def whole(text: str) -> int | None:
    """The whole number that a word stands for, if it stands for one.

    >>> whole("12"), whole("zwoelf"), whole("fuenfundvierzig"), whole("docks")
    (12, 12, 45, None)
    """
    if text.isascii() and text.isdigit():
        return int(text[:9])
    found = _GERMAN_TENS.fullmatch(text)
    if found and found[2] in NAMED:
        ones = 1 if found[1] == "ein" else NAMED[found[1]]
        return NAMED[found[2]] + ones
    return NAMED.get(text)


def decimal(text: str) -> float | None:
    """The number that digits stand for, with a point or a comma."""
    if not re.fullmatch(r"\d{1,9}([.,]\d{1,9})?|\.\d{1,9}", text):
        return None
    return float(text.replace(",", "."))


def counted(words: Sequence[Word], at: int) -> tuple[float, int] | None:
    """A number in digits or words from word `at` on, and the word behind it: "forty-five"."""
    text = text_at(words, at)
    value = decimal(text)
    if value is None and (number := whole(text)) is not None:
        value = float(number)
    if value is None:
        return None
    end = at + 1
    dash = 1 if text_at(words, end) == "-" else 0
    ones = whole(text_at(words, end + dash))
    if text in _TENS and ones is not None and ones < 10 and text_at(words, end + dash).isalpha():
        return value + ones, end + dash + 1
    return value, end


def share_at(words: Sequence[Word], at: int) -> Share | None:
    """The part that is written from word `at` on."""
    if at >= len(words):
        return None
    return _percent(words, at) or _fraction(words, at) or _bare(words, at) or _times(words, at)


def _minus(words: Sequence[Word], at: int) -> int:
    """-1 behind a minus sign that belongs to no word before it."""
    touches = at > 1 and words[at - 1].start == words[at - 2].end
    return -1 if text_at(words, at - 1) in {"-", "−", "minus"} and not touches else 1


def _percent(words: Sequence[Word], at: int) -> Share | None:
    """ "90 percent", "ninety five per cent", "85%"."""
    found = counted(words, at)
    if found is None:
        return None
    value, end = found
    ones = _UNITS.get(text_at(words, end), 10)
    if words[at].text in _UNITS and 0 < value < 10 and ones < 10:
        value, end = 10 * value + ones, end + 1  # "Seven zero percent", by radio.
    if text_at(words, end) == "-":
        end += 1
    if text_at(words, end) == "per" and text_at(words, end + 1) in {"cent", "cents"}:
        end += 2
    elif text_at(words, end) in _PERCENT:
        end += 1
    else:
        return None
    return Share(at, end, _minus(words, at) * round(value / 100, 4))


def _fraction(words: Sequence[Word], at: int) -> Share | None:
    """ "half", "a third", "two thirds", "drei Viertel", "1/3"."""
    text = words[at].text
    top = whole(text)
    if text.isdigit() and text_at(words, at + 1) == "/" and text_at(words, at + 2).isdigit():
        bottom = int(text_at(words, at + 2)[:6])
        return Share(at, at + 3, round(int(text[:6]) / bottom, 3)) if bottom else None
    if text in _ONE or top is not None:
        part = _PARTS.get(text_at(words, at + 1))
        if part is None or text_at(words, at + 1) == "halb":
            return None
        return Share(at, at + 2, round((1 if top is None else top) / part, 3))
    if text == "dreiviertel":
        return Share(at, at + 1, 0.75)
    part = _PARTS.get(text)
    return None if part is None else Share(at, at + 1, round(1 / part, 3))


def _bare(words: Sequence[Word], at: int) -> Share | None:
    """ "0.8"; whole numbers alone are no part of anything."""
    text = words[at].text
    if not re.fullmatch(r"[01]?[.,]\d{1,4}", text):
        return None
    return Share(at, at + 1, _minus(words, at) * (decimal(text) or 0.0))


def _times(words: Sequence[Word], at: int) -> Share | None:
    """ "three times": more than the whole."""
    number = whole(words[at].text)
    if number is not None and number > 1 and text_at(words, at + 1) in {"times", "mal"}:
        return Share(at, at + 2, float(number))
    return None
