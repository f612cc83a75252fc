"""A payload with the outline of what surrounds its sender, by which its pose can be corrected.

Body: uint8 number of places, each x and y as 12-bit steps of 2.5 cm from -51.2 m on in the sensor's
frame (three bytes a place, little endian, x in the low bits), and the payload itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.codec.envelope import seal, unseal
from swarm.errors import PayloadError

KIND_OUTLINED = 24
STEP_M = 0.025
_HALF = 2048
_MOST = 255
_BYTES = 3


def add_outline(payload: bytes, places: NDArray[np.float64]) -> bytes:
    """The payload with places (N, 2), metres; those beyond 51 m or the 255th are left out."""
    steps = np.rint(places / STEP_M)
    steps = steps[(np.abs(steps) < _HALF).all(axis=1)][:_MOST].astype(np.int64) + _HALF
    words = (steps[:, 0] | steps[:, 1] << 12).astype("<u4")
    octets = words.view(np.uint8).reshape(-1, 4)[:, :_BYTES]
    return seal(KIND_OUTLINED, bytes((len(steps),)) + octets.tobytes() + payload)


def take_outline(payload: bytes) -> tuple[bytes, NDArray[np.float64]]:
    """The payload inside, and the places float64 (N, 2) in the sensor's frame, metres.

    Raises PayloadError when it is corrupt, truncated or of another kind.
    """
    kind, body = unseal(payload)
    if kind != KIND_OUTLINED:
        raise PayloadError(f"payload kind {kind} has no outline ({KIND_OUTLINED})")
    end = 1 + _BYTES * body[0] if body else 1
    if len(body) < end:
        raise PayloadError(f"a body of {len(body)} bytes does not hold its outline")
    octets = np.zeros((body[0], 4), dtype=np.uint8)
    octets[:, :_BYTES] = np.frombuffer(body[1:end], np.uint8).reshape(-1, _BYTES)
    words = octets.view("<u4")[:, 0].astype(np.int64)
    steps = np.column_stack([words & 0xFFF, words >> 12]) - _HALF
    return body[end:], steps * STEP_M
