"""Reads parts of a whole as people write them: "half", "90 percent", "zwei Drittel", "0,75"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from llm_gateway.wishes.numbers import (
    AND,
    ARTICLES,
    HUNDRED,
    POINT,
    SMALL,
    counted,
    decimal,
    decimals,
    integer_at,
    is_physical,
    whole,
)
from llm_gateway.wishes.words import Word, text_at

_PARTS = {
    "half": 2, "halves": 2, "halfs": 2, "haelfte": 2, "halbe": 2, "halben": 2, "halb": 2,
    "halber": 2, "halbes": 2, "third": 3, "thirds": 3, "drittel": 3, "quarter": 4, "quarters": 4,
    "viertel": 4, "fourths": 4, "fifth": 5, "fifths": 5, "fuenftel": 5, "sixths": 6, "sechstel": 6,
    "sevenths": 7, "siebtel": 7, "eighths": 8, "achtel": 8, "ninths": 9, "neuntel": 9, "tenth": 10,
    "tenths": 10, "zehntel": 10, "twentieths": 20, "zwanzigstel": 20, "hundredths": 100,
    "hundertstel": 100,
}  # fmt: skip
_NTHS = {"fourth": 4, "sixth": 6, "seventh": 7, "eighth": 8, "ninth": 9, "twentieth": 20}
"""Parts before "of"; elsewhere they count on: "the fourth robot"."""
FRACTIONS = {"1⁄2": 1 / 2, "1⁄3": 1 / 3, "2⁄3": 2 / 3, "1⁄4": 1 / 4, "3⁄4": 3 / 4}
"""Signs as they are folded: "½"."""
_OUT_OF = {5, 10, 100}
"""Of so many is a part told: "nine out of ten"."""
PERCENT = {"%", "percent", "pct", "prozent", "perc", "percents", "procent", "proz"}
_JOINS = AND | {",", "-", "–", "bis", "in", "of", "oder", "or", "out", "to", "von"}
"""Between two numbers they may make another one, or a range, of both."""
_TORN = HUNDRED | POINT | {"dozen", "dutzend", "ein", "eine", "odd", "tausend", "thousand"}
"""What belongs to a number besides those that stand for one."""
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
    ones = SMALL.get(text_at(words, end), 10)
    if words[at].text in SMALL and 0 < value < 10 and ones < 10:
        value, end = 10 * value + ones, end + 1  # "Seven zero percent", by radio.
    if text_at(words, end) == "-":
        end += 1
    if text_at(words, end) == "per" and text_at(words, end + 1) in {"cent", "cents"}:
        end += 2
    elif text_at(words, end) in PERCENT:
        end += 1
    else:
        return None
    return Share(at, end, _minus(words, at) * round(value / 100, 4))


def _fraction(words: Sequence[Word], at: int) -> Share | None:
    """ "half", "a third", "two thirds", "drei Viertel", "1/3", "nine out of ten"."""
    text = words[at].text
    if text in FRACTIONS:
        return Share(at, at + 1, round(FRACTIONS[text], 3))
    if text.isdecimal() and text_at(words, at + 1) == "/" and text_at(words, at + 2).isdecimal():
        bottom = int(text_at(words, at + 2)[:6])
        return Share(at, at + 3, round(int(text[:6]) / bottom, 3)) if bottom else None
    found = (1, at + 1) if text in ARTICLES else integer_at(words, at)
    if found is not None:
        top, end = found
        if (bottom_at := _out_of(words, end)) is not None and top <= bottom_at[0]:
            return Share(at, bottom_at[1], round(top / bottom_at[0], 3))
        end += text_at(words, end) == "-"
        part = _part(text_at(words, end))
        if part is None and text_at(words, end + 1) == "of" and text not in {"the", "der"}:
            part = _NTHS.get(text_at(words, end))
        if part is None or text_at(words, end) == "halb":
            return None
        return Share(at, end + 1, round(top / part, 3))
    if text in {"dreiviertel", "dreivierteln"}:
        return Share(at, at + 1, 0.75)
    part = _part(text)
    return None if part is None else Share(at, at + 1, round(1 / part, 3))


def _part(text: str) -> int | None:
    """How many of it make the whole: 5 of "fifths", "Fünftel" and "Fünfteln"."""
    return _PARTS.get(text.removesuffix("n") if text.endswith("teln") else text)


def _out_of(words: Sequence[Word], at: int) -> tuple[int, int] | None:
    """What "out of ten" makes the whole, from word `at` on, and the word behind it."""
    if (text_at(words, at), text_at(words, at + 1)) != ("out", "of"):
        return None
    found = integer_at(words, at + 2)
    return found if found is not None and found[0] in _OUT_OF else None


def counts_parts(words: Sequence[Word], at: int) -> bool:
    """Whether the number from word `at` on counts parts and is no hour: "four-fifths", "20 pct".

    >>> from llm_gateway.wishes.words import words
    >>> counts_parts(words("four-fifths"), 0), counts_parts(words("six half the link"), 0)
    (True, False)
    """
    share = share_at(words, at)
    last = "" if share is None else text_at(words, share.last - 1)
    return share is not None and _part(last) != 2 and last not in {"times", "mal"}


def _bare(words: Sequence[Word], at: int) -> Share | None:
    """ "0.8", "null Komma acht"; whole numbers alone are no part of anything."""
    text = words[at].text
    said = counted(words, at)
    if text in POINT and QUALITY.fullmatch(text_at(words, at - 1)):
        digits, end = decimals(words, at)  # "Minimum quality point eight".
        return Share(at, end, float(f"0.{digits}")) if digits else None
    if said is not None and said[1] > at + 1 and said[0] <= 1 and said[0] % 1:
        return Share(at, said[1], _minus(words, at) * said[0])
    if not re.fullmatch(r"[01]?[.,]\d{1,4}", text) or is_physical(words, at + 1):
        return None
    return Share(at, at + 1, _minus(words, at) * (decimal(text) or 0.0))


def _times(words: Sequence[Word], at: int) -> Share | None:
    """ "three times": more than the whole."""
    number = whole(words[at].text)
    if number is not None and number > 1 and text_at(words, at + 1) in {"times", "mal"}:
        return Share(at, at + 2, float(number))
    return None


def is_torn(words: Sequence[Word], at: int, behind: int) -> bool:
    """Whether the number from word `at` on is but the end of one that was not read: "three or five
    minutes". `behind`: the word behind what was read before it."""
    if whole(text_at(words, at)) is None and text_at(words, at) not in ARTICLES | {*_PARTS}:
        return False
    here = at - 1
    while text_at(words, here) in _JOINS:
        here -= 1
    text = text_at(words, here)
    if text == "one" and {word.text for word in words[here + 1 : at]} <= {","}:
        return False  # "The old one, five minutes".
    return here >= behind and (text in _TORN or whole(text) is not None)
