"""Scans as range images, to the last bit: where a ray's direction is known, its range says all.

A sensor that measures in steps (`worlds.base.Rays`) gives a whole number for each ray. Neighbours
differ by little, so a point of twelve bytes takes less than one.
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from options.recordings.format import Ranges, SensorRays
from swarm.errors import WorldError
from swarm.geometry import TWO_PI, Points
from worlds.base import Rays

MAX_STEPS = 2**15 - 1
"""Ranges beyond are not coded: the difference of two must fit into 16 bits."""
MAX_RAYS = 2**20
"""Of a sensor; a recording that names more is damaged."""
VIEW_EVERY = 3
VIEW_CELL_M = 0.25
VIEW_STEP_M = 1 / 16
"""What viewers are shown of a scan that is kept as ranges: of every third point the first in each
cell, rounded. As large as the ranges, a twentieth of the scan."""


def put_rays(rays: Rays) -> SensorRays:
    """A grid of rays as it is recorded."""
    rings, columns, _ = rays.directions.shape
    directions = zlib.compress(np.ascontiguousarray(rays.directions, dtype="<f4").tobytes(), 6)
    return SensorRays(rings=rings, columns=columns, step_m=rays.step_m, directions=directions)


def take_rays(found: SensorRays) -> Rays:
    """Reverses `put_rays`. Raises WorldError when it is damaged."""
    count = found.rings * found.columns
    if count > MAX_RAYS:
        raise WorldError(f"a sensor of {count} rays is none; allowed: 1 to {MAX_RAYS}")
    table = np.frombuffer(_unpack(found.directions, 12 * count), dtype="<f4").astype(np.float32)
    return Rays(table.reshape(found.rings, found.columns, 3), found.step_m)


def put_scan(points: Points, rays: Rays) -> Ranges | None:
    """A scan as ranges; None where they would not give back each point to the last bit."""
    rings, columns, _ = rays.directions.shape
    wide = points.astype(np.float64)
    distance = np.sqrt(np.einsum("ij,ij->i", wide, wide))
    steps = np.rint(distance / rays.step_m)
    if not len(points) or not (steps.min() >= 1 and steps.max() <= MAX_STEPS):
        return None
    rising = rays.directions[:, 0, 2]
    ring = np.searchsorted((rising[1:] + rising[:-1]) / 2, wide[:, 2] / distance)
    turn = np.arctan2(points[:, 1], points[:, 0]) * np.float32(columns / TWO_PI)
    place = ring * columns + np.rint(turn).astype(np.int64) % columns
    if not (np.diff(place) > 0).all():
        return None
    steps = steps.astype(np.int32)
    if not np.array_equal(_points(place, steps, rays), points):
        return None
    there = np.zeros(rings * columns, dtype=np.bool_)
    there[place] = True
    change = np.diff(steps, prepend=0)
    folded = ((change << 1) ^ (change >> 31)).astype(np.uint16)
    low, high = (folded & 0xFF).astype(np.uint8), (folded >> 8).astype(np.uint8)
    return Ranges(
        points=len(points),
        present=_pack(np.packbits(there)),
        low=_pack(low),
        high=_pack(high),
    )


def take_scan(found: Ranges, rays: Rays) -> Points:
    """Reverses `put_scan`: float32 (N, 3). Raises WorldError when it is damaged."""
    count = rays.directions.shape[0] * rays.directions.shape[1]
    bits = np.frombuffer(_unpack(found.present, -(-count // 8)), dtype=np.uint8)
    place = np.flatnonzero(np.unpackbits(bits)[:count])
    if len(place) != found.points:
        raise WorldError(f"a scan of {found.points} points has {len(place)} ranges")
    low, high = (
        np.frombuffer(_unpack(part, len(place)), dtype=np.uint8).astype(np.int32)
        for part in (found.low, found.high)
    )
    folded = low | high << 8
    steps = np.cumsum((folded >> 1) ^ -(folded & 1), dtype=np.int32)
    return _points(place, steps, rays)


def for_view(points: Points) -> Points:
    """Some of a scan's points, float32 (M, 3), for people to look at."""
    some = points[::VIEW_EVERY]
    if not len(some):
        return some
    cells = np.floor(some / np.float32(VIEW_CELL_M)).astype(np.int64)
    cells -= cells.min(axis=0)
    wide, high = cells[:, 1].max() + 1, cells[:, 2].max() + 1
    _, first = np.unique((cells[:, 0] * wide + cells[:, 1]) * high + cells[:, 2], return_index=True)
    shown: Points = np.rint(some[np.sort(first)] / np.float32(VIEW_STEP_M))
    return shown * np.float32(VIEW_STEP_M)


def _points(place: NDArray[np.int64], steps: NDArray[np.int32], rays: Rays) -> Points:
    # In the order of a sensor's arithmetic: another one ends in other bits.
    ranges = steps.astype(np.float32) * np.float32(rays.step_m)
    found: Points = rays.directions.reshape(-1, 3)[place] * ranges[:, None]
    return found


def _pack(plane: NDArray[np.uint8]) -> bytes:
    # Noise does not repeat: looking for repetitions costs three times as much and gains nothing.
    packer = zlib.compressobj(1, strategy=zlib.Z_RLE)
    return packer.compress(plane.tobytes()) + packer.flush()


def _unpack(packed: bytes, size: int) -> bytes:
    """Never more than `size` bytes, whatever is packed. Raises WorldError for another number."""
    try:
        unpacker = zlib.decompressobj()
        found = unpacker.decompress(packed, size + 1)
    except zlib.error as error:
        raise WorldError(f"packed ranges are damaged: {error}") from error
    if len(found) != size:
        raise WorldError(f"packed ranges hold {len(found)} bytes or more, not {size}")
    return found
