"""Residuals as symbols of an entropy coder and raw bits.

Symbol 0: no return. Symbol 1 + 2 m - (residual > 0): a residual of magnitude class m. Classes 0 to
15 are the magnitudes themselves; from 16 on there are two classes an octave, and the bits below
the two leading ones follow as raw bits (the "hybrid integers" of JPEG XL, ISO/IEC 18181-1).
"""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from perception.codec.interlace import Flags, Ints
from perception.kernels.library import coding, pointer
from swarm.errors import PayloadError

DIRECT_BITS = 4
DIRECT = 1 << DIRECT_BITS
MAX_BITS = 22
"""A residual has at most this many bits: 1000 m in steps of 1 mm need 20."""
SYMBOLS = 1 + 2 * (DIRECT + 2 * (MAX_BITS - DIRECT_BITS))

_CLASSES = np.arange(SYMBOLS // 2 + 1)
_OCTAVE = DIRECT_BITS + (_CLASSES - DIRECT) // 2
_RAW_BITS = np.where(_CLASSES < DIRECT, 0, _OCTAVE - 1).astype(np.int32)
_BASE = np.where(
    _CLASSES < DIRECT, _CLASSES, (2 + (_CLASSES - DIRECT) % 2) << np.maximum(_OCTAVE - 1, 0)
).astype(np.int32)

TOO_FEW = "raw bits of the residuals end too early"


def to_symbols(residual: Ints, present: Flags) -> tuple[NDArray[np.uint8], bytes]:
    """Symbols and packed raw bits of residuals (n,) whose magnitude is below 2**22."""
    compiled = coding()
    if compiled is not None:
        residual, present = np.ascontiguousarray(residual), np.ascontiguousarray(present)
        symbols = np.empty(residual.shape, dtype=np.uint8)
        bits = np.empty(3 * residual.size + 1, dtype=np.uint8)
        written = compiled.residuals_write(
            *(pointer(residual), pointer(present), residual.size, pointer(symbols), pointer(bits))
        )
        return symbols, bits[: -(-written // 8)].tobytes()
    magnitude = np.abs(residual)
    kind = magnitude.copy()
    large = np.flatnonzero(magnitude >= DIRECT)
    size = magnitude[large]
    octave = np.frexp(size)[1] - 1
    kind[large] = DIRECT + 2 * (octave - DIRECT_BITS) + ((size >> (octave - 1)) & 1)
    symbol = 1 + 2 * kind - (residual > 0)
    symbol *= present
    return symbol.astype(np.uint8), _pack(size, octave - 1)


class RawBits:
    """Reads raw bits in the order in which they were packed."""

    def __init__(self, data: bytes) -> None:
        self._octets = np.frombuffer(data + bytes(4), dtype=np.uint8)
        self._end = 8 * len(data)
        self.at = 0
        """The next bit."""

    def to_residuals(self, symbols: NDArray[np.uint8]) -> tuple[Ints, Flags]:
        """Residuals and presence of symbols. Raises PayloadError when the bits run out."""
        compiled = coding()
        if compiled is not None:
            return self._read_in_c(compiled, symbols)
        kind = symbols.astype(np.int32)
        sign = 1 - 2 * (kind & 1)
        kind >>= 1
        present = symbols > 0
        residual = _BASE[kind]
        large = np.flatnonzero(kind >= DIRECT)
        residual[large] += self._read(_RAW_BITS[kind[large]])
        residual *= sign
        return residual, present

    def arguments(self) -> tuple[int | None, ...]:
        """Classes, bits and their end, as coding.c takes them."""
        return pointer(_BASE), pointer(_RAW_BITS), pointer(self._octets), self._end

    def finish(self) -> None:
        """Raises PayloadError when whole bytes are left over."""
        if self._end - self.at >= 8:
            raise PayloadError(f"{self._end - self.at} raw bits of the residuals are left over")

    def _read_in_c(self, compiled: ctypes.CDLL, symbols: NDArray[np.uint8]) -> tuple[Ints, Flags]:
        symbols = np.ascontiguousarray(symbols)
        residual = np.empty(symbols.shape, dtype=np.int32)
        present = np.empty(symbols.shape, dtype=np.bool_)
        self.at = compiled.residuals_read(
            *(pointer(symbols), symbols.size, pointer(_BASE), pointer(_RAW_BITS)),
            *(pointer(self._octets), self.at, self._end, pointer(residual), pointer(present)),
        )
        if self.at < 0:
            raise PayloadError(TOO_FEW)
        return residual, present

    def _read(self, lengths: Ints) -> Ints:
        ends = self.at + np.cumsum(lengths)
        starts = ends - lengths
        if len(ends):
            self.at = int(ends[-1])
        if self.at > self._end:
            raise PayloadError(TOO_FEW)
        octet = starts >> 3
        window = np.zeros(len(octet), dtype=np.uint32)
        for place in range(4):
            window |= self._octets[octet + place].astype(np.uint32) << np.uint32(24 - 8 * place)
        window <<= (starts & 7).astype(np.uint32)
        values: Ints = (window >> (32 - lengths).astype(np.uint32)).astype(np.int32)
        return values


def _pack(values: Ints, lengths: NDArray[np.int32]) -> bytes:
    """The lowest `lengths` bits of each value, most significant first."""
    ends = np.cumsum(lengths)
    total = int(ends[-1]) if len(ends) else 0
    # distance of every bit from the end of its value
    below = np.repeat(ends, lengths) - 1 - np.arange(total)
    bits = np.repeat(values, lengths) >> below & 1
    return np.packbits(bits.astype(np.uint8)).tobytes()
