"""A range image as runs of contexts and residuals, and back: what `interlace.walk` asks about it.

The compiled loops answer all passes in one call; without them the walk asks for each.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from perception.codec import rans, residuals, tables
from perception.codec.interlace import (
    FIRST_ACTIVITY,
    SPACING,
    UNIT,
    UNIT_BITS,
    Answer,
    Flags,
    Ints,
    Question,
    walk,
)
from perception.codec.residuals import RawBits
from perception.kernels.library import coding, pointer
from swarm.errors import PayloadError

_PASSES = 2 * (SPACING.bit_length() - 1)
_STREAM_ENDED = -1
"""What `interlace_read` returns when the stream ended too early; -2: the raw bits did."""


@dataclass(frozen=True, slots=True)
class Runs:
    """What is asked about the cells of an image, and the answers, pass after pass; (n,) each."""

    contexts: Ints
    residuals: Ints
    """In steps."""
    present: Flags
    lengths: list[int]
    """Of the runs: the first columns and the passes."""


def record(value: Ints, present: Flags) -> Runs:
    """The runs of an image (columns, rings): ranges in 1 / UNIT of a step, and returns."""
    columns, rings = value.shape
    recorder = _Recorder(value, present)
    first = recorder.first()
    compiled = coding()
    if compiled is None:
        walk(*first, columns, recorder)
        return recorder.runs()
    cells = _Padded(*first)
    start = first[0].size
    contexts, steps = (np.empty(start + cells.size, dtype=np.int32) for _ in range(2))
    answered = np.empty(start + cells.size, dtype=np.bool_)
    lengths = np.empty(_PASSES, dtype=np.int64)
    beginning = recorder.runs()
    contexts[:start], steps[:start] = beginning.contexts, beginning.residuals
    answered[:start] = beginning.present
    compiled.interlace_record(
        *(pointer(value), pointer(present), columns, rings, SPACING, *cells.arguments()),
        *(pointer(part[start:]) for part in (contexts, steps, answered)),
        pointer(lengths),
    )
    used = value.size
    passes: list[int] = lengths.tolist()
    return Runs(contexts[:used], steps[:used], answered[:used], [*beginning.lengths, *passes])


def restore(columns: int, rings: int, symbols: rans.Decoder, raw: RawBits) -> Answer:
    """Values and presence of the image (columns, rings) that was recorded.

    Raises PayloadError when symbols or raw bits run out or are left over.
    """
    reader = _Reader(symbols, raw)
    first = reader.first(-(-columns // SPACING), rings)
    compiled = coding()
    if compiled is None:
        image = walk(*first, columns, reader)
    else:
        image = _restored(compiled, first, columns, symbols, raw)
    symbols.finish()
    raw.finish()
    return image


def _restored(
    compiled: ctypes.CDLL, first: Answer, columns: int, symbols: rans.Decoder, raw: RawBits
) -> Answer:
    cells = _Padded(*first)
    context, residual = (np.empty(cells.size, dtype=np.int32) for _ in range(2))
    answered, found = (np.empty(cells.size, dtype=np.uint8) for _ in range(2))
    at = np.array([symbols.at, raw.at], dtype=np.int64)
    ended = compiled.interlace_read(
        *(columns, first[0].shape[1], SPACING, *cells.arguments()),
        *(pointer(part) for part in (context, residual, answered, found)),
        *(*symbols.arguments(), *raw.arguments(), pointer(at)),
    )
    if ended:
        raise PayloadError(rans.TOO_FEW if ended == _STREAM_ENDED else residuals.TOO_FEW)
    symbols.at, raw.at = at.tolist()
    return cells.value[:columns], cells.present[:columns]


class _Padded:
    """An image of which every SPACING-th column is known, with room for all others."""

    def __init__(self, first: Ints, present: Flags) -> None:
        shape = len(first) * SPACING, first.shape[1]
        self.value = np.empty(shape, dtype=np.int32)
        self.present = np.empty(shape, dtype=np.bool_)
        self._activity = np.empty(shape, dtype=np.int32)
        self._prediction = np.empty(self.value.size, dtype=np.int32)
        self.value[::SPACING], self.present[::SPACING] = first, present
        self._activity[::SPACING] = FIRST_ACTIVITY

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.value.size

    def arguments(self) -> tuple[int | None, ...]:
        """As coding.c takes them."""
        parts = self.value, self.present, self._activity, self._prediction
        return len(self.value), *(pointer(part) for part in parts)


class _Recorder:
    """Answers for the cells of a known image and keeps what was asked."""

    def __init__(self, value: Ints, present: Flags) -> None:
        self._value = value
        self._present = present
        self._contexts: list[Ints] = []
        self._residuals: list[Ints] = []
        self._presence: list[Flags] = []

    def first(self) -> Answer:
        """Values and presence of the first columns, coded as differences from ring to ring."""
        present = self._present[::SPACING]
        steps = (self._value[::SPACING] + UNIT // 2) >> UNIT_BITS
        ring = np.where(present, np.arange(steps.shape[1], dtype=np.intp), -1)
        ring = np.maximum.accumulate(ring, axis=1)
        filled = np.take_along_axis(steps, np.maximum(ring, 0), axis=1) * (ring >= 0)
        change = np.diff(filled, axis=1, prepend=np.int32(0))
        self._keep(np.full_like(change, tables.FIRST), change, present)
        return (filled << UNIT_BITS).astype(np.int32), present

    def __call__(self, question: Question) -> Answer:
        """Residuals and presence of one pass."""
        present = self._present[question.columns, question.rings]
        residual = self._value[question.columns, question.rings] - question.prediction
        residual += UNIT // 2
        residual >>= UNIT_BITS
        residual *= present
        self._keep(question.context, residual, present)
        return residual, present

    def _keep(self, context: Ints, residual: Ints, present: Flags) -> None:
        self._contexts.append(context.reshape(-1))
        self._residuals.append(residual.reshape(-1))
        self._presence.append(present.reshape(-1))

    def runs(self) -> Runs:
        """All that was asked so far."""
        return Runs(
            np.concatenate(self._contexts),
            np.concatenate(self._residuals),
            np.concatenate(self._presence),
            [len(run) for run in self._contexts],
        )


class _Reader:
    """Answers for the cells of an encoded image."""

    def __init__(self, symbols: rans.Decoder, raw: RawBits) -> None:
        self._symbols = symbols
        self._raw = raw

    def first(self, columns: int, rings: int) -> Answer:
        """Values and presence of the first columns."""
        symbols = self._symbols.take(np.full(columns * rings, tables.FIRST, dtype=np.int32))
        change, present = self._raw.to_residuals(symbols)
        steps = np.cumsum(change.reshape(columns, rings), axis=1, dtype=np.int32)
        return steps << UNIT_BITS, present.reshape(columns, rings)

    def __call__(self, question: Question) -> Answer:
        """Residuals and presence of one pass."""
        symbols = self._symbols.take(question.context.reshape(-1))
        residual, present = self._raw.to_residuals(symbols)
        return residual.reshape(question.context.shape), present.reshape(question.context.shape)
