"""Prediction of a range image from its own coarser versions, in integers.

Every 32nd column comes first. Then each round halves the spacing: the columns between two known
ones are predicted from them, first in the even rings, then in the odd rings, which also know the
rings above and below. A round sees the values that the decoder will have, so errors never add up,
and works on whole arrays in both directions of the codec. The idea is that of pyramid and
interlaced image coders (Burt and Adelson 1983, doi:10.1109/TCOM.1983.1095851).

Values are ranges in 1/64 of a quantisation step; a residual is a whole number of steps. A cell
without a return takes its prediction, so that every neighbour always has a value. All arithmetic
is on int32 (wrapping around in damaged payloads), so that every machine predicts the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int32]
Flags = NDArray[np.bool_]
Kind = TypeVar("Kind", np.int32, np.bool_)

UNIT_BITS = 6
UNIT = 1 << UNIT_BITS
SPACING = 32
"""Columns from one column of the first pass to the next."""
MAGNITUDES = 9
"""Classes of the size of residual that is to be expected."""
SURROUNDINGS = 9
"""Classes of how many neighbours have a return, 0 (none) to 8 (all)."""
PASSES = 2
"""Kinds of pass: even rings, odd rings."""

_ACTIVITY_CAP = 64
FIRST_ACTIVITY = 8
_EXPECTED_CAP = 520
_CLASS_OF = np.searchsorted(
    (3, 8, 16, 32, 64, 128, 256, _EXPECTED_CAP), np.arange(_EXPECTED_CAP + 1), "right"
).astype(np.int32)
"""Expected residual in 1/16 steps to its class; the thresholds double."""


@dataclass(frozen=True, slots=True)
class Question:
    """What is known about the cells of one pass before they are coded; arrays (n, m)."""

    columns: slice
    rings: slice
    prediction: Ints
    context: Ints
    """(pass * MAGNITUDES + magnitude) * SURROUNDINGS + surroundings."""


Answer = tuple[Ints, Flags]
"""Residuals in steps (0 where there is no return), and which cells have a return."""
Coder = Callable[[Question], Answer]


@dataclass(frozen=True, slots=True)
class _Cells:
    """Known cells, arrays (columns, rings)."""

    value: Ints
    present: Flags
    activity: Ints
    """Size of the residual in 1/16 steps: how unpredictable this place was."""

    def rings(self, part: slice) -> _Cells:
        return _Cells(self.value[:, part], self.present[:, part], self.activity[:, part])


@dataclass(frozen=True, slots=True)
class _Between:
    """What two opposite neighbours say about the cell between them."""

    prediction: Ints
    gap: Ints
    seen: Ints
    """How many of the two have a return."""
    activity: Ints

    def rings(self, part: slice) -> _Between:
        return _Between(
            self.prediction[:, part], self.gap[:, part], self.seen[:, part], self.activity[:, part]
        )


def walk(first: Ints, present: Flags, columns: int, code: Coder) -> tuple[Ints, Flags]:
    """Visits all cells beyond the first columns once and lets `code` answer for them.

    `first` and `present` (ceil(columns / 32), rings) are values and returns of every 32nd column.
    Returns values and presence of the whole image, (columns, rings).
    """
    cells = _Cells(first, present, np.full_like(first, FIRST_ACTIVITY))
    spacing = SPACING
    while spacing > 1:
        cells = _refine(cells, slice(spacing // 2, columns, spacing), code)
        spacing //= 2
    return cells.value[:columns], cells.present[:columns]


def _refine(left: _Cells, new: slice, code: Coder) -> _Cells:
    """One round: the known columns with a new one (of the image's columns `new`) after each."""
    rings = left.value.shape[1]
    right = _Cells(
        np.roll(left.value, -1, 0), np.roll(left.present, -1, 0), np.roll(left.activity, -1, 0)
    )
    sides = _between(left, right)

    even = slice(0, rings, 2)
    question = Question(new, even, sides.prediction[:, even], _even_context(sides)[:, even])
    upper = _ask(question, sides.activity[:, even], code)

    odd = slice(1, rings, 2)
    sides = sides.rings(odd)
    above = upper.rings(slice(0, rings // 2))
    levels = _between(above, _next_ring(upper, rings // 2))
    prediction, context = _odd(sides, levels)
    middle = _ask(Question(new, odd, prediction, context), sides.activity, code)

    return _Cells(
        _weave(left.value, upper.value, middle.value),
        _weave(left.present, upper.present, middle.present),
        _weave(left.activity, upper.activity, middle.activity),
    )


def _weave(known: NDArray[Kind], even: NDArray[Kind], odd: NDArray[Kind]) -> NDArray[Kind]:
    """The known columns, each followed by a new one made of its even and odd rings."""
    count, rings = known.shape
    both = np.empty((count, 2, rings), dtype=known.dtype)
    both[:, 0] = known
    both[:, 1, 0::2] = even
    both[:, 1, 1::2] = odd
    return both.reshape(-1, rings)


def _between(a: _Cells, b: _Cells) -> _Between:
    """Mean and difference of neighbours; one with a return outweighs one without 15 to 1."""
    difference = a.value - b.value
    prediction = (a.value + b.value) >> 1
    lean = difference * 7 >> 4
    lean *= a.present.astype(np.int32) - b.present
    prediction += lean
    return _Between(
        prediction,
        np.abs(difference),
        a.present.astype(np.int32) + b.present,
        a.activity + b.activity,
    )


def _even_context(sides: _Between) -> Ints:
    """Contexts of the cells that know only the columns on both sides, (columns, all rings)."""
    activity = (2 * sides.activity + _above_and_below(sides.activity)) >> 2
    return _context(0, (sides.gap >> 3) + activity, 2 * sides.seen + _above_and_below(sides.seen))


def _odd(sides: _Between, levels: _Between) -> tuple[Ints, Ints]:
    """Predictions and contexts of the cells that know their neighbours on all four sides.

    A pair that agrees is trusted more; pairs that agree about equally are averaged. A missing
    return counts as a disagreement of one step.
    """
    doubt = sides.gap + ((2 - sides.seen) << UNIT_BITS)
    level_doubt = levels.gap + ((2 - levels.seen) << UNIT_BITS)
    prediction = np.where(level_doubt < doubt, levels.prediction, sides.prediction)
    similar = np.maximum(doubt, level_doubt) < 3 * np.minimum(doubt, level_doubt) + 2 * UNIT
    prediction = np.where(similar, (sides.prediction + levels.prediction) >> 1, prediction)
    apart = np.minimum(sides.gap, levels.gap) + np.abs(sides.prediction - levels.prediction)
    expected = (apart >> 4) + ((sides.activity + levels.activity) >> 1)
    return prediction, _context(1, expected, 2 * (sides.seen + levels.seen))


def _context(kind: int, expected: Ints, seen: Ints) -> Ints:
    magnitude = _CLASS_OF[np.clip(expected, 0, _EXPECTED_CAP)]
    return (magnitude + kind * MAGNITUDES) * SURROUNDINGS + seen


def _ask(question: Question, activity: Ints, code: Coder) -> _Cells:
    """The cells of a pass; those beyond the last column are not asked for and stay empty."""
    new = question.columns
    asked = len(range(new.start, new.stop, new.step))
    residual, answered = code(
        Question(new, question.rings, question.prediction[:asked], question.context[:asked])
    )
    value = question.prediction.copy()
    value[:asked] += residual << UNIT_BITS
    present = np.zeros(value.shape, dtype=np.bool_)
    present[:asked] = answered
    seen_activity = activity >> 1
    size = np.minimum(np.abs(residual), _ACTIVITY_CAP) << 4
    seen_activity[:asked] = np.where(answered, size, seen_activity[:asked])
    return _Cells(value, present, seen_activity)


def _above_and_below(part: Ints) -> Ints:
    """Sum of the two neighbouring rings; the outermost rings count themselves instead."""
    total = np.empty_like(part)
    total[:, 1:] = part[:, :-1]
    total[:, 0] = part[:, 0]
    total[:, :-1] += part[:, 1:]
    total[:, -1] += part[:, -1]
    return total


def _next_ring(upper: _Cells, count: int) -> _Cells:
    """The even rings that follow `count` odd ones; below the last ring an empty copy of it."""
    below = upper.rings(slice(1, None))
    if below.value.shape[1] == count:
        return below
    last = upper.rings(slice(-1, None))
    nothing = np.zeros_like(last.present)
    return _Cells(
        np.concatenate([below.value, last.value], axis=1),
        np.concatenate([below.present, nothing], axis=1),
        np.concatenate([below.activity, last.activity], axis=1),
    )
