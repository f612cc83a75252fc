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
from perception.codec.image import record, restore
from perception.codec.interlace import UNIT, Flags, Ints
from perception.codec.residuals import RawBits, to_symbols
from perception.kernels.library import coding, pointer
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

    asked = record(value, present)
    symbols, raw = to_symbols(asked.residuals, asked.present)
    weights = tables.count(asked.contexts, symbols)
    ends = np.cumsum(asked.lengths)[:-1]
    runs = list(zip(np.split(asked.contexts, ends), np.split(symbols, ends), strict=True))
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
    decoder = rans.Decoder(stream, tables.from_weights(weights), lanes)
    value, present = restore(header.columns, header.rings, decoder, RawBits(raw))
    grid = SensorGrid(elevations, header.columns, header.phase)
    cloud = _positions(grid, value, present, header.step_m)
    if at == len(body):
        return cloud
    return np.concatenate([cloud, generic.decode(body[at:], max_points - len(cloud))])


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
    rays = grid.rays()
    compiled = coding()
    if compiled is not None:
        points = np.empty((int(np.count_nonzero(present)), 3), dtype=np.float32)
        directions = rays.cos_elevation, rays.sin_elevation, rays.cos_azimuth, rays.sin_azimuth
        compiled.cells_to_points(
            *(pointer(value), pointer(present), grid.columns, grid.rings, step_m / UNIT),
            *(*(pointer(part) for part in directions), pointer(points)),
        )
        return points
    column, ring = np.nonzero(present)
    range_m = value[present] * (step_m / UNIT)
    flat = range_m * rays.cos_elevation[ring]
    cloud = np.empty((len(ring), 3), dtype=np.float32)
    cloud[:, 0] = flat * rays.cos_azimuth[column]
    cloud[:, 1] = flat * rays.sin_azimuth[column]
    cloud[:, 2] = range_m * rays.sin_elevation[ring]
    return cloud
