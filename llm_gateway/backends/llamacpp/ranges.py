"""Grammar rules (GBNF) for numbers between two bounds."""

from __future__ import annotations

import math
from decimal import Decimal

DECIMALS = 3
"""Digits after the point, at most. More cost tokens and mean nothing to a small model."""


def integers(low: int, high: int) -> str:
    """A rule for the decimal numbers from `low` to `high`, without leading zeros."""
    if low > high:
        raise ValueError(f"no integer lies between {low} and {high}")
    parts = []
    if low < 0:
        parts += [f'"-" ({rule})' for rule in _naturals(max(1, -high), -low)]
    if high >= 0:
        parts += _naturals(max(0, low), high)
    return " | ".join(parts)


def decimals(low: float, high: float) -> str:
    """A rule for numbers from `low` to `high`, with at most `DECIMALS` digits after the point.

    Bounds that are finer than that are moved inwards.
    """
    unit = 10**DECIMALS
    first, last = math.ceil(Decimal(repr(low)) * unit), math.floor(Decimal(repr(high)) * unit)
    if first > last:
        raise ValueError(f"no number of {DECIMALS} decimals lies between {low} and {high}")
    parts = []
    if first < 0:
        parts += [f'"-" ({rule})' for rule in _fixed(max(1, -last), -first)]
    if last >= 0:
        parts += _fixed(max(0, first), last)
    return " | ".join(parts)


def _naturals(low: int, high: int) -> list[str]:
    """One alternative for each number of digits."""
    found = []
    for digits in range(len(str(low)), len(str(high)) + 1):
        smallest = 0 if digits == 1 else 10 ** (digits - 1)
        from_, to = max(low, smallest), min(high, 10**digits - 1)
        found.append(_same_width(str(from_), str(to)))
    return found


def _fixed(low: int, high: int) -> list[str]:
    """Alternatives for numbers given in thousandths (units of the last decimal)."""
    unit = 10**DECIMALS
    any_fraction = f'("." [0-9]{{1,{DECIMALS}}})?'
    whole_low, whole_high = -(-low // unit), (high + 1) // unit - 1
    found = []
    if whole_low <= whole_high:
        found += [f"({rule}) {any_fraction}" for rule in _naturals(whole_low, whole_high)]
    for whole in sorted({low // unit, high // unit}):
        if whole_low <= whole <= whole_high:
            continue
        from_, to = max(low - whole * unit, 0), min(high - whole * unit, unit - 1)
        if from_ == 0:
            found.append(f'"{whole}"')
            from_ = 1
        if from_ <= to:
            width = DECIMALS
            fraction = _same_width(str(from_).zfill(width), str(to).zfill(width))
            found.append(f'"{whole}." ({fraction})')
    return found


def _same_width(low: str, high: str) -> str:
    """A rule for the digit strings from `low` to `high`, both of the same length."""
    if low == high:
        return f'"{low}"'
    if len(low) == 1:
        return f"[{low}-{high}]"
    if low[0] == high[0]:
        return f'"{low[0]}" ({_same_width(low[1:], high[1:])})'
    rest = len(low) - 1
    parts = []
    first, last = int(low[0]), int(high[0])
    if low[1:] != "0" * rest:
        parts.append(f'"{first}" ({_same_width(low[1:], "9" * rest)})')
        first += 1
    tail = None
    if high[1:] != "9" * rest:
        tail = f'"{last}" ({_same_width("0" * rest, high[1:])})'
        last -= 1
    if first <= last:
        parts.append(f"[{first}-{last}] [0-9]{{{rest}}}")
    return " | ".join([*parts, tail] if tail else parts)
