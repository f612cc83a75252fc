"""Reads numbers as people write them: "12", "0,75", "a hundred and five", "fünf und zwanzig"."""

from __future__ import annotations

import re
from collections.abc import Sequence

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
SMALL = {text: n for line in (_ENGLISH, _GERMAN) for n, text in enumerate(line.split())}
_SOUTHERN = {
    "zwo": 2, "zwoa": 2, "viere": 4, "fuenfe": 5, "sechse": 6, "siebene": 7, "achte": 8, "neune": 9,
    "zehne": 10, "elfe": 11, "zwoelfe": 12, "vieri": 4, "fuefi": 5, "foifi": 5, "saechsi": 6,
    "sechsi": 6, "siebni": 7, "sibni": 7, "achti": 8, "nueni": 9, "zehni": 10, "elfi": 11,
    "zwoelfi": 12,
}  # fmt: skip
NAMED = SMALL | _TENS | _SOUTHERN
_GERMAN_HUNDREDS = re.compile(r"(ein|[a-z]{3,6})?hundert(?:und)?(\w*)")
_GERMAN_TENS = re.compile(r"(ein|[a-z]{3,6})und(zwanzig|\w+ssig|\w+zig)")
HUNDRED = {"hundred", "hundert"}
POINT = {"comma", "komma", "point"}
_SHORT_TENS = re.compile(r"\w+(?:z|ss)g")
"""So tens end in the south: "achtzg", "dreissg"."""
_BETWEEN = {"between", "zwischen"}
AND = {"and", "und"}
ARTICLES = {"a", "an", "one", "the", "ein", "eine", "einen", "einem", "einer", "der", "die", "das"}
_PHYSICAL = frozenset(
    """ah bar c celsius cm db dbm deg degree degrees f fahrenheit g ghz grad hz kg khz km kmh
    knots kw kwh lux m mah mbar mhz mm mph ms mv ns ppm psi px rpm ton tons tonne tonnen tonnes
    v volt volts w watt μm μs °""".split()
)
"""Units of what no wish can bound."""


def whole(text: str) -> int | None:
    """The whole number that a word stands for, if it stands for one.

    >>> whole("12"), whole("zwoelf"), whole("hundertfuenfundvierzig"), whole("docks")
    (12, 12, 145, None)
    """
    if text.isascii() and text.isdecimal():
        return int(text[:9])
    if text in NAMED:
        return NAMED[text]
    if _SHORT_TENS.fullmatch(text):
        return whole(text.removesuffix("g") + "ig")
    if (found := _GERMAN_HUNDREDS.fullmatch(text)) is not None:
        hundreds, rest = _times_of(found[1] or "ein"), whole(found[2] or "null")
        rest = 1 if found[2] == "ein" else rest
        return None if hundreds is None or rest is None else 100 * hundreds + rest
    if (found := _GERMAN_TENS.fullmatch(text)) is not None:
        ones, tens = _times_of(found[1]), NAMED.get(found[2])
        return None if ones is None or tens is None else tens + ones
    return None


def _times_of(text: str) -> int | None:
    """A number below ten before "und" or "hundert"."""
    number = 1 if text == "ein" else NAMED.get(text)
    return number if number is not None and 0 < number < 10 else None


def decimal(text: str) -> float | None:
    """The number that digits stand for, with a point or a comma."""
    if not re.fullmatch(r"\d{1,9}([.,]\d{1,9})?|\.\d{1,9}", text):
        return None
    return float(text.replace(",", "."))


def integer_at(words: Sequence[Word], at: int) -> tuple[int, int] | None:
    """A whole number in digits or words from word `at` on, and the word behind it.

    >>> from llm_gateway.wishes.words import words
    >>> integer_at(words("a hundred and twenty-five minutes"), 0)
    (125, 6)
    """
    text, end = text_at(words, at), at + 1
    value = whole(text)
    if text in ARTICLES and text_at(words, end) in HUNDRED:
        value = 1
    if value is None or text.isdecimal():
        return None if value is None else (value, end)
    if value < 10 and text_at(words, end) in HUNDRED:
        value, end = 100 * value, end + 1
    if value >= 100 and value % 100 == 0:
        rest = _below_hundred(words, end + (text_at(words, end) in AND))
        return (value, end) if rest is None else (value + rest[0], rest[1])
    return _below_hundred(words, at) or (value, end)


def _below_hundred(words: Sequence[Word], at: int) -> tuple[int, int] | None:
    """ "five", "seventeen", "twenty-five", "ninety five"."""
    value, end = _said(words, at), at + 1
    if value is None or not 0 < value < 100:
        return None
    behind = end + (text_at(words, end) == "-")
    ones = _said(words, behind)
    if value >= 20 and value % 10 == 0 and ones is not None and 0 < ones < 10:
        return value + ones, behind + 1
    return value, end


def _said(words: Sequence[Word], at: int) -> int | None:
    """The number that one word stands for, not in digits."""
    text = text_at(words, at)
    return whole(text) if text.isalpha() else None


def counted(words: Sequence[Word], at: int) -> tuple[float, int] | None:
    """A number in digits or words from word `at` on, and the word behind it: "one point five"."""
    value = decimal(text_at(words, at))
    if value is not None:
        return value, at + 1
    found = tens_behind(words, at) or integer_at(words, at)
    if found is None:
        return None
    number, end = found
    digits, last = decimals(words, end)
    return (float(f"{number}.{digits}"), last) if digits else (float(number), end)


def tens_behind(words: Sequence[Word], at: int) -> tuple[int, int] | None:
    """ "fünf und zwanzig", written apart."""
    ones = 1 if text_at(words, at) == "ein" else _said(words, at)
    here = at + 1 + (text_at(words, at + 1) == "-")
    if text_at(words, here) != "und" or text_at(words, at - 1) in _BETWEEN:
        return None
    here += 1 + (text_at(words, here + 1) == "-")
    tens = _said(words, here)
    if ones is None or tens is None or not 0 < ones < 10 or tens < 20 or tens % 10:
        return None
    return ones + tens, here + 1


def decimals(words: Sequence[Word], at: int) -> tuple[str, int]:
    """The digits behind "point", said one by one or as one number, and the word behind them."""
    digits, here = "", at + 1
    if text_at(words, at) not in POINT:
        return "", at
    while (found := _below_hundred(words, here)) is not None or _said(words, here) == 0:
        digits, here = f"{digits}{found[0] if found else 0}", found[1] if found else here + 1
    return digits, here


def is_physical(words: Sequence[Word], at: int) -> bool:
    """Whether word `at` is a unit of what no wish can bound, and begins no name: "C3".

    >>> from llm_gateway.wishes.words import words
    >>> is_physical(words("94 C now"), 1), is_physical(words("0.8 C3 out"), 1)
    (True, False)
    """
    if text_at(words, at) not in _PHYSICAL:
        return False
    behind = words[at + 1] if at + 1 < len(words) else None
    named = behind is not None and words[at].end == behind.start and behind.text not in ".,;:!?)"
    return not named or words[at].text == "°"
