"""Points on the wire: quantised, with a bound on the error of every point.

The cloud of a spinning sensor, or a part of one, in any order of points, takes the spinning form;
all other clouds take the generic one. docs/codec.md describes both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.codec import generic, spinning
from perception.codec.envelope import seal, unseal
from perception.types import Points, clean_points
from swarm.errors import PayloadError, ScanError

MAX_POINTS = 4_000_000
MAX_RANGE_M = 1000.0
"""A coordinate beyond this is no LiDAR return, but a cloud in the wrong unit or frame."""
ERROR_LIMITS_M = (0.001, 1.0)
KIND_GENERIC = 1
KIND_SPINNING = 2
_SMALL = 4000
"""Below this many points the fixed parts of the spinning form may outweigh its gain."""


def encode_points(points: NDArray[np.floating], max_error_m: float = 0.1) -> bytes:
    """The payload of a cloud, float32 (N, 3), metres, in the sensor's frame.

    The Euclidean error of every decoded point is at most `max_error_m` (0.001 to 1). Points with
    NaN or infinity are dropped; the order of the others may change.

    >>> from worlds.registry import open_world
    >>> scan = open_world("factory", robots=2, rings=16).scan("R1", 0)
    >>> payload = encode_points(scan.points, max_error_m=0.05)
    >>> len(payload) < 0.1 * scan.points.nbytes
    True
    >>> decode_points(payload).shape == scan.points.shape
    True

    Raises ScanError when the array is not (N, 3), has more than 4 million points, or a
    coordinate beyond 1000 m: a clipped point would break the error bound silently.
    """
    low, high = ERROR_LIMITS_M
    if not low <= max_error_m <= high:
        raise ScanError(f"max_error_m must be from {low} to {high}, is {max_error_m}")
    cloud = clean_points(points)
    if len(cloud) > MAX_POINTS:
        raise ScanError(f"a cloud may have {MAX_POINTS} points, this one has {len(cloud)}")
    reach = float(np.abs(cloud).max(initial=0.0))
    if reach > MAX_RANGE_M:
        raise ScanError(f"a coordinate is {reach:.6g} m, allowed are {MAX_RANGE_M:.0f} m")
    scan = spinning.encode(cloud, max_error_m)
    if scan is not None and len(cloud) > _SMALL:
        return seal(KIND_SPINNING, scan)
    plain = generic.encode(cloud, max_error_m)
    if scan is not None and len(scan) < len(plain):
        return seal(KIND_SPINNING, scan)
    return seal(KIND_GENERIC, plain)


def decode_points(payload: bytes, max_points: int = MAX_POINTS) -> Points:
    """The cloud of a payload, float32 (N, 3), metres, in the frame it was encoded in.

    Raises PayloadError when the payload is corrupt, truncated, of another version, or announces
    more than `max_points`.
    """
    kind, body = unseal(payload)
    if kind == KIND_SPINNING:
        return spinning.decode(body, max_points)
    if kind == KIND_GENERIC:
        return generic.decode(body, max_points)
    raise PayloadError(f"payload kind {kind} is not points ({KIND_GENERIC} or {KIND_SPINNING})")
