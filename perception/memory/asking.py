"""What an ego asks robots about between their whole contributions: the places of its tracks.

What is remembered grows old by its own motion alone; the rest of a scene hardly changes. So points
of these places tell most of what a whole scan would, in a few of its bytes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from perception.codec.places import Places, encode_places
from perception.memory.memory import Remembered
from swarm.geometry import Matrix, invert

AROUND_M = 1.0
"""Around a track's box: poses and what is remembered are off, and a box needs its surroundings."""

LONGEST_S = 1.0
"""So long what is remembered says where to look."""


def places_of(tracks: Remembered, after_s: float, world_from_sensor: Matrix) -> Places:
    """The places of tracks, the likeliest first, so long after they were where they are said to be,
    in the frame of the asking ego's sensor."""
    moved = tracks.boxes.centers.copy()
    moved[:, :2] += after_s * tracks.velocities
    boxes = replace(tracks.boxes, centers=moved).transformed(invert(world_from_sensor))
    order = np.argsort(-boxes.scores, kind="stable")
    return encode_places(boxes.take(order), AROUND_M)
