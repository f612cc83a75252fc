"""Interleaved rANS: an entropy coder whose lanes run side by side in numpy, or in C where that was
compiled (perception/kernels): the same bytes in less time.

Range asymmetric numeral systems (Duda, arXiv:1311.2540) with 32-bit states, 16-bit words and
frequencies that sum to 4096; many lanes share one word stream (Giesen, arXiv:1402.3392).
Symbol i of a run goes to lane i mod lanes, so a step of all lanes is one numpy operation.

Stream: the lanes' final states (uint32), then the words (uint16) in the order of decoding.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from perception.kernels.library import coding, pointer
from swarm.errors import PayloadError

PRECISION = 12
TOTAL = 1 << PRECISION
_LOW = 1 << 16
"""States lie in [2**16, 2**32) between steps."""

TOO_FEW = "entropy stream ends too early"

Run = tuple[NDArray[np.int32], NDArray[np.uint8]]
"""Contexts and symbols, (n,) each."""


class Tables:
    """Frequencies of symbols per context, uint32 (contexts, symbols); each row sums to 4096.

    A frequency of 4096 is not representable: every row needs two symbols.
    """

    def __init__(self, frequencies: NDArray[np.uint32]) -> None:
        self.symbols = frequencies.shape[1]
        self.frequency = np.ascontiguousarray(frequencies)
        starts = np.zeros_like(frequencies)
        np.cumsum(frequencies[:, :-1], axis=1, out=starts[:, 1:])
        self.start = starts

    def by_slot(self) -> NDArray[np.uint8]:
        """The symbol of each of the 4096 slots of each context, flat."""
        rows = len(self.frequency)
        symbols = np.tile(np.arange(self.symbols, dtype=np.uint8), rows)
        return np.repeat(symbols, self.frequency.reshape(-1))


def encode(runs: list[Run], tables: Tables, lanes: int) -> bytes:
    """The stream of runs of (context, symbol); every symbol's frequency must be above zero."""
    state = np.full(lanes, _LOW, dtype=np.uint32)
    compiled = coding()
    if compiled is not None:
        return _put(compiled, runs, tables, state)
    words: list[NDArray[np.uint16]] = []
    shift = np.uint32(16)
    for contexts, symbols in reversed(runs):
        cell = contexts * tables.symbols + symbols
        frequency = tables.frequency.reshape(-1)[cell]
        start = tables.start.reshape(-1)[cell]
        full = frequency << np.uint32(32 - PRECISION)
        rest = np.uint32(TOTAL) - frequency
        first = (len(symbols) - 1) // lanes * lanes
        for at in range(first, -1, -lanes):
            here = slice(at, at + lanes)
            x = state[: len(frequency[here])]
            spill = x >= full[here]
            words.append(x[spill].astype(np.uint16))
            np.right_shift(x, shift, out=x, where=spill)
            # x // f * 4096 + x % f + start, without the remainder
            quotient = x // frequency[here]
            quotient *= rest[here]
            x += quotient
            x += start[here]
    words.append(state.view(np.uint16))
    words.reverse()
    return np.concatenate(words).astype("<u2").tobytes()


def _put(
    compiled: ctypes.CDLL, runs: list[Run], tables: Tables, state: NDArray[np.uint32]
) -> bytes:
    """`encode` in C."""
    if not runs:
        return state.astype("<u4").tobytes()
    contexts = np.concatenate([contexts for contexts, _ in runs], dtype=np.int32)
    symbols = np.concatenate([symbols for _, symbols in runs], dtype=np.uint8)
    lengths = np.array([len(symbols) for _, symbols in runs], dtype=np.int64)
    # A symbol takes one word at most.
    words = np.empty(len(symbols), dtype=np.uint16)
    put = compiled.rans_put(
        *(pointer(contexts), pointer(symbols), pointer(lengths), len(lengths), len(symbols)),
        *(pointer(tables.frequency), pointer(tables.start), tables.symbols),
        *(pointer(state), len(state), pointer(words)),
    )
    stream = np.concatenate([state.view(np.uint16), words[len(words) - put :]])
    return stream.astype("<u2").tobytes()


class Decoder:
    """Reads a stream run by run; contexts of a run may depend on the runs before it."""

    def __init__(self, stream: bytes, tables: Tables, lanes: int) -> None:
        """Raises PayloadError when the stream is too short to hold the states."""
        if len(stream) < 4 * lanes or len(stream) % 2:
            raise PayloadError(f"entropy stream of {len(stream)} bytes is truncated")
        self._state = np.frombuffer(stream, "<u4", lanes).astype(np.uint32)
        words = np.frombuffer(stream, "<u2", offset=4 * lanes)
        # a step reads at most one word a lane; padding keeps a damaged stream within bounds
        self._compiled = coding()
        self._words = np.concatenate([words, np.zeros(lanes, words.dtype)]).astype(np.uint16)
        self._end = len(words)
        self.at = 0
        """The next word."""
        self._tables = tables
        self._slots = tables.by_slot()

    def take(self, contexts: NDArray[np.int32]) -> NDArray[np.uint8]:
        """The symbols of the next run. Raises PayloadError when the stream ends too early."""
        lanes = len(self._state)
        symbols = np.empty(len(contexts), dtype=np.uint8)
        if self._compiled is not None:
            contexts = np.ascontiguousarray(contexts)
            *model, stream, end = self.arguments()
            self.at = self._compiled.rans_take(
                *(pointer(contexts), len(contexts), *model, stream),
                *(self.at, end, pointer(symbols)),
            )
            if self.at < 0:
                raise PayloadError(TOO_FEW)
            return symbols
        slot_row = contexts << PRECISION
        cell_row = contexts * self._tables.symbols
        frequencies = self._tables.frequency.reshape(-1)
        starts = self._tables.start.reshape(-1)
        for at in range(0, len(contexts), lanes):
            here = slice(at, at + lanes)
            rows = slot_row[here]
            x = self._state[: len(rows)]
            slot = x & np.uint32(TOTAL - 1)
            symbol = self._slots[rows + slot]
            symbols[here] = symbol
            cell = cell_row[here] + symbol
            x >>= np.uint32(PRECISION)
            x *= frequencies[cell]
            x += slot
            x -= starts[cell]
            hungry = np.flatnonzero(x < _LOW)
            if len(hungry):
                words = self._words[self.at : self.at + len(hungry)].astype(np.uint32)
                x[hungry] = (x[hungry] << np.uint32(16)) | words
                self.at += len(hungry)
                if self.at > self._end:
                    raise PayloadError(TOO_FEW)
        return symbols

    def arguments(self) -> tuple[int | None, ...]:
        """Slots, frequencies, starts, symbols, states, lanes, words and their end, as coding.c
        takes them."""
        tables = self._tables
        return (
            *(pointer(self._slots), pointer(tables.frequency), pointer(tables.start)),
            *(tables.symbols, pointer(self._state), len(self._state)),
            *(pointer(self._words), self._end),
        )

    def finish(self) -> None:
        """Raises PayloadError unless the whole stream was read and every lane came home."""
        if self.at != self._end or (self._state != _LOW).any():
            raise PayloadError("entropy stream does not end where it must")
