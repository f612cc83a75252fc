"""Places on the ground that an ego asks robots about, in the frame of its sensor.

Each is an upright rectangle of 7 bytes, little endian: int16 x and y of its middle in steps of
2 cm, uint8 length and width in steps of 0.1 m, uint8 heading of the length in steps of 1/256 of a
turn.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes
from swarm.errors import PayloadError
from swarm.geometry import Points

Places = bytes
"""As they are encoded here."""
MOST_PLACES = 128
MIDDLE_STEP_M = 0.02
SIDE_STEP_M = 0.1
HEADING_STEP = 2.0 * math.pi / 256.0
_PLACE = np.dtype([("middle", "<i2", 2), ("sides", "u1", 2), ("heading", "u1")])
_FARTHEST = 32_767
_LONGEST = 255


def encode_places(boxes: Boxes, around_m: float) -> Places:
    """The places of the first MOST_PLACES boxes in the sensor's frame, each with so much around it.
    Those beyond 655 m are left out; sides are 25.5 m at most."""
    middles = np.rint(boxes.centers[:, :2] / MIDDLE_STEP_M)
    near = np.flatnonzero((np.abs(middles) <= _FARTHEST).all(axis=1))[:MOST_PLACES]
    found = np.zeros(len(near), dtype=_PLACE)
    found["middle"] = middles[near]
    sides = np.ceil((boxes.sizes[near, :2] + 2.0 * around_m) / SIDE_STEP_M - 1e-6)
    found["sides"] = np.clip(sides, 1, _LONGEST)
    found["heading"] = np.rint(boxes.headings[near] / HEADING_STEP).astype(np.int64) % 256
    return found.tobytes()


def within(places: Places, points: Points) -> NDArray[np.bool_]:
    """Which points (N, 3) in the asking sensor's frame lie in one of the places, (N,).

    Raises PayloadError for what `encode_places` does not give.
    """
    if len(places) % _PLACE.itemsize or len(places) > MOST_PLACES * _PLACE.itemsize:
        raise PayloadError(
            f"{len(places)} bytes are no places; allowed: up to {MOST_PLACES} of {_PLACE.itemsize}"
        )
    inside = np.zeros(len(points), dtype=np.bool_)
    order = np.argsort(points[:, 0])
    sorted_x = points[order, 0]
    for place in np.frombuffer(places, dtype=_PLACE):
        middle_x, middle_y = place["middle"] * np.float32(MIDDLE_STEP_M)
        half_x, half_y = place["sides"] * (SIDE_STEP_M / 2.0)
        reach = math.hypot(half_x, half_y)
        first, last = np.searchsorted(sorted_x, [middle_x - reach, middle_x + reach])
        near = order[first:last]
        x, y = sorted_x[first:last] - middle_x, points[near, 1] - middle_y
        heading = float(place["heading"]) * HEADING_STEP
        along, across = math.cos(heading), math.sin(heading)
        lies = np.abs(x * along + y * across) <= half_x
        lies &= np.abs(y * along - x * across) <= half_y
        inside[near[lies]] = True
    return inside
