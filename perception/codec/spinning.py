"""Clouds of a spinning sensor: a range image, interlaced and entropy coded.

Body, little endian: the header (see _Header), then four parts:
    side     zlib of the elevations as second differences (int32) and the weights of the tables
    raw      raw bits of large residuals
    stream   rANS stream of the symbols
    rest     generic body of the points that do not fit the pattern; may be missing
"""

from __future__ import annotations

import math
import struct
import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perception.codec import generic, rans, tables
from perception.codec.envelope import inflate
from perception.codec.grid import MAX_CELLS, MAX_COLUMNS, MAX_RINGS, SensorGrid, find_grid
from perception.codec.interlace import (
    SPACING,
    UNIT,
    UNIT_BITS,
    Answer,
    Flags,
    Ints,
    Question,
    walk,
)
from perception.codec.residuals import RawBits, to_symbols
from perception.types import Points
from swarm.errors import PayloadError

_MAX_LANES = 1024
_CELLS_PER_LANE = 128
"""Twice as many cells a lane take 6 to 10 % fewer bytes and a third more time to decode."""
_RANGE_LIMITS_M = (0.1, 400.0)
"""Outside, float32 angles are not exact enough for the stated bound."""
_MAX_REST = 0.25
"""With a larger share of points without a place the generic body is smaller."""


class _Header(NamedTuple):
    step_m: float
    """A residual of 1."""
    phase: float
    """Azimuth of column 0, radians."""
    rings: int
    columns: int
    plain_bytes: int
    """Of the side part, decompressed."""
    side_bytes: int
    raw_bytes: int
    stream_bytes: int


_HEAD = struct.Struct("<ddHHHHII")


def encode(cloud: Points, max_error_m: float) -> bytes | None:
    """The body of a finite cloud, or None when it shows no scan pattern."""
    found = find_grid(cloud)
    if found is None:
        return None
    grid, places = found
    # |p - p'|^2 = (r - r')^2 + r r' |d - d'|^2 for directions d, and r' <= r + max_error
    aside = places.apart * np.sqrt(places.range_m * (places.range_m + np.float32(max_error_m)))
    allowed = _allowance(aside, max_error_m)
    near, far = _RANGE_LIMITS_M
    fits = (places.cell >= 0) & (aside <= allowed)
    fits &= (places.range_m >= near) & (places.range_m <= far)
    chosen, rest = _owners(places.cell, fits, grid.rings * grid.columns)
    if len(rest) > _MAX_REST * len(cloud):
        return None

    # the range itself is rounded to 1/64 step before the residual is rounded to a step
    range_error = math.sqrt(max_error_m**2 - allowed**2) - generic.ROUNDING_M
    step = 2.0 * range_error / (1.0 + 1.0 / UNIT)
    value = np.zeros((grid.columns, grid.rings), dtype=np.int32)
    present = np.zeros(value.shape, dtype=np.bool_)
    cells = places.cell[chosen]
    value.reshape(-1)[cells] = np.rint(places.range_m[chosen].astype(np.float64) * (UNIT / step))
    present.reshape(-1)[cells] = True

    recorder = _Recorder(value, present)
    walk(*recorder.first(), grid.columns, recorder)
    runs, weights, raw = recorder.statistics()
    stream = rans.encode(runs, tables.from_weights(weights), _lanes(value.size))
    curve = np.diff(grid.elevations, n=2, prepend=np.zeros(2, np.int32)).astype("<i4")
    plain = curve.tobytes() + weights
    side = zlib.compress(plain, 9)
    header = _Header(
        step_m=step,
        phase=grid.phase,
        rings=grid.rings,
        columns=grid.columns,
        plain_bytes=len(plain),
        side_bytes=len(side),
        raw_bytes=len(raw),
        stream_bytes=len(stream),
    )
    remainder = generic.encode(cloud[rest], max_error_m) if len(rest) else b""
    return _HEAD.pack(*header) + side + raw + stream + remainder


def decode(body: bytes, max_points: int) -> Points:
    """The cloud of a body. Raises PayloadError when it does not hold what its header says."""
    header = _read_header(body)
    parts = []
    at = _HEAD.size
    for size in (header.side_bytes, header.raw_bytes, header.stream_bytes):
        parts.append(body[at : at + size])
        at += size
    side, raw, stream = parts
    plain = inflate(side, header.plain_bytes, "side part of points")
    curve = np.frombuffer(plain, "<i4", header.rings)
    elevations = np.cumsum(np.cumsum(curve, dtype=np.int32), dtype=np.int32)
    weights = plain[4 * header.rings :]
    lanes = _lanes(header.rings * header.columns)
    reader = _Reader(rans.Decoder(stream, tables.from_weights(weights), lanes), RawBits(raw))
    first = reader.first(-(-header.columns // SPACING), header.rings)
    value, present = walk(*first, header.columns, reader)
    reader.finish()
    grid = SensorGrid(elevations, header.columns, header.phase)
    cloud = _positions(grid, value, present, header.step_m)
    if at == len(body):
        return cloud
    return np.concatenate([cloud, generic.decode(body[at:], max_points - len(cloud))])


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

    def statistics(self) -> tuple[list[rans.Run], bytes, bytes]:
        """Runs of (contexts, symbols), weights of the tables, raw bits."""
        symbols, raw = to_symbols(np.concatenate(self._residuals), np.concatenate(self._presence))
        weights = tables.count(np.concatenate(self._contexts), symbols)
        ends = np.cumsum([len(run) for run in self._contexts])[:-1]
        return list(zip(self._contexts, np.split(symbols, ends), strict=True)), weights, raw


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

    def finish(self) -> None:
        """Raises PayloadError when something is left over."""
        self._symbols.finish()
        self._raw.finish()


def _lanes(cells: int) -> int:
    """Lanes of the entropy coder: more cost bytes (3 each), fewer cost time."""
    return min(max(cells // _CELLS_PER_LANE, 1), _MAX_LANES)


def _allowance(aside: NDArray[np.float32], max_error_m: float) -> float:
    """How far beside its ray a point may lie: the least share that covers all but 1 in 200."""
    shares = (0.1, 0.2, 0.35, 0.5)
    for share in shares:
        if np.count_nonzero(aside > share * max_error_m) * 200 <= len(aside):
            return share * max_error_m
    return shares[-1] * max_error_m


def _owners(cell: Ints, fits: Flags, cells: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the points that get a cell of their own, and of all others."""
    index = np.arange(len(cell))
    owner = np.full(cells + 1, -1, dtype=np.intp)
    target = np.where(fits, cell, cells)
    owner[target] = index
    owns = fits & (owner[target] == index)
    return np.flatnonzero(owns), np.flatnonzero(~owns)


def _read_header(body: bytes) -> _Header:
    """Raises PayloadError when a number is out of range."""
    if len(body) < _HEAD.size:
        raise PayloadError(f"points body has {len(body)} bytes, at least {_HEAD.size} are needed")
    header = _Header(*_HEAD.unpack_from(body))
    parts = header.side_bytes + header.raw_bytes + header.stream_bytes
    if (
        not 0.0 < header.step_m < 10.0
        or not abs(header.phase) <= math.tau
        or not 1 <= header.rings <= MAX_RINGS
        or not 1 <= header.columns <= MAX_COLUMNS
        or header.rings * header.columns > MAX_CELLS
        or not 4 * header.rings <= header.plain_bytes <= 4 * header.rings + tables.MAX_WEIGHTS
        or _HEAD.size + parts > len(body)
    ):
        raise PayloadError(f"points header is out of range for {len(body)} bytes: {header}")
    return header


def _positions(grid: SensorGrid, value: Ints, present: Flags, step_m: float) -> Points:
    """Positions of the cells with a return, column by column."""
    column, ring = np.nonzero(present)
    rays = grid.rays()
    range_m = value[present] * (step_m / UNIT)
    flat = range_m * rays.cos_elevation[ring]
    cloud = np.empty((len(ring), 3), dtype=np.float32)
    cloud[:, 0] = flat * rays.cos_azimuth[column]
    cloud[:, 1] = flat * rays.sin_azimuth[column]
    cloud[:, 2] = range_m * rays.sin_elevation[ring]
    return cloud
