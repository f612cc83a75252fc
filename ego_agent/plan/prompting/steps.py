"""Coarse numbers: they cost few tokens and stay the same while the world hardly changes."""

from __future__ import annotations

import math

_LADDER = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
"""Of one decade; each step is about 1.5 times the one before."""
_PERCENT: tuple[int, ...] = (0, 1, 2, 3, 5, 7, 10, 15, *range(20, 101, 10))
_E12 = (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2, 10.0)
"""The ladder of resistors: each step is about 1.2 times the one before (IEC 60063)."""
SMALLEST, LARGEST = 1e-3, 1e9
LARGEST_M = 1e5


def coarse(value: float) -> float:
    """The nearest number of a ladder of 1.5 times each; 0 for none and what is no number."""
    if not value > 0.0:
        return 0.0
    value = min(max(value, SMALLEST), LARGEST)
    decade = 10.0 ** math.floor(math.log10(value))
    return min((step * decade for step in _LADDER), key=lambda near: abs(math.log(near / value)))


def at_most(value: float) -> float:
    """The largest number of a ladder of 1.2 times each that is not larger; 0 for less than 0.01."""
    if not value >= 1e-2:
        return 0.0
    value = min(value, LARGEST)
    decade = 10.0 ** math.floor(math.log10(value))
    return max(step * decade for step in (0.82, *_E12) if step * decade <= value)


def percent(share: float) -> int:
    """A share in [0, 1] as one of few percentages, finer where it is small."""
    value = 100.0 * share if share > 0.0 else 0.0
    return min(_PERCENT, key=lambda near: abs(near - value))


def place(metres: float, step_m: int) -> int:
    """The nearest multiple of a step, in metres; a world ends at 100 km."""
    if not math.isfinite(metres):
        return 0
    return step_m * round(min(max(metres, -LARGEST_M), LARGEST_M) / step_m)


def shown(value: float) -> str:
    """A number of a ladder, as short as it gets."""
    return f"{value:.3g}" if value < 1e3 else f"{value:.0f}"
