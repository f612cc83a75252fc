"""Clouds without structure: quantised coordinates, differences in scan order, byte planes, zlib.

Body: float64 step in metres, uint32 count, uint8 number of planes, then the zlib stream of the
bytes of the zigzag differences, plane by plane (all lowest bytes of x, y, z, then the second
bytes, ...).
"""

from __future__ import annotations

import struct
import zlib

import numpy as np

from perception.codec.envelope import inflate
from perception.types import Points
from swarm.errors import PayloadError

_HEAD = struct.Struct("<dIB")
ROUNDING_M = 1e-4
"""What float32 may add to the error of a point at 1000 m."""


def encode(cloud: Points, max_error_m: float) -> bytes:
    """The body for a finite cloud; every point keeps within `max_error_m` (>= 0.001)."""
    step = 2.0 * (max_error_m - ROUNDING_M) / np.sqrt(3.0)
    cells = np.rint(cloud.T.astype(np.float64) / step).astype(np.int32)
    change = np.diff(cells, axis=1, prepend=np.int32(0))
    zigzag = ((change << 1) ^ (change >> 31)).view(np.uint32)
    planes = max(1, (int(zigzag.max(initial=0)).bit_length() + 7) // 8)
    octets = np.ascontiguousarray(zigzag.astype("<u4")).view(np.uint8).reshape(-1, 4)
    packed = zlib.compress(np.ascontiguousarray(octets[:, :planes].T).tobytes(), 1)
    return _HEAD.pack(step, len(cloud), planes) + packed


def decode(body: bytes, max_points: int) -> Points:
    """The cloud of a body. Raises PayloadError when it does not hold what its header says."""
    if len(body) < _HEAD.size:
        raise PayloadError(f"points body has {len(body)} bytes, at least {_HEAD.size} are needed")
    step, count, planes = _HEAD.unpack_from(body)
    if count > max_points or not 1 <= planes <= 4 or not 0.0 < step < 10.0:
        raise PayloadError(f"points header is out of range: {count=} {planes=} {step=}")
    raw = inflate(body[_HEAD.size :], 3 * count * planes, "points")
    octets = np.zeros((3 * count, 4), dtype=np.uint8)
    octets[:, :planes] = np.frombuffer(raw, dtype=np.uint8).reshape(planes, 3 * count).T
    zigzag = octets.view("<u4").reshape(3, count)
    change = (zigzag >> 1).astype(np.int32) ^ -(zigzag & 1).astype(np.int32)
    cells = np.cumsum(change, axis=1, dtype=np.int64)
    return np.ascontiguousarray((cells * step).T, dtype=np.float32)
