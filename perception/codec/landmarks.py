"""Points with the landmarks that the sender sees, by which its pose can be corrected.

Body: uint8 number of landmarks, their x and y as int16 in centimetres in the sensor's frame, and
the payload of the points as `perception.codec.points` makes it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.codec.envelope import seal, unseal
from perception.codec.points import decode_points
from perception.types import Points
from swarm.errors import PayloadError

KIND_LANDMARKED = 24
STEP_M = 0.01
_FARTHEST = 32767 * STEP_M
_MOST = 255


def add_landmarks(points: bytes, landmarks: NDArray[np.float64]) -> bytes:
    """The payload of points with landmarks (N, 2), metres; those beyond 327 m or the 255th are
    left out."""
    near = landmarks[(np.abs(landmarks) < _FARTHEST).all(axis=1)][:_MOST]
    steps = np.rint(near / STEP_M).astype("<i2")
    return seal(KIND_LANDMARKED, bytes((len(near),)) + steps.tobytes() + points)


def take_landmarks(payload: bytes, max_points: int) -> tuple[Points, NDArray[np.float64]]:
    """Points float32 (N, 3) and landmarks float64 (M, 2) of a payload, in the sensor's frame.

    Raises PayloadError when it is corrupt, truncated, of another kind, or has too many points.
    """
    kind, body = unseal(payload)
    if kind != KIND_LANDMARKED:
        raise PayloadError(f"payload kind {kind} is not points with landmarks ({KIND_LANDMARKED})")
    end = 1 + 4 * body[0] if body else 1
    if len(body) < end:
        raise PayloadError(f"a body of {len(body)} bytes does not hold its landmarks")
    steps = np.frombuffer(body[1:end], "<i2").reshape(-1, 2)
    return decode_points(body[end:], max_points), steps * STEP_M
