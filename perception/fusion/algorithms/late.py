"""Late fusion: robots detect on their own and send boxes; the ego merges the boxes."""

from __future__ import annotations

import numpy as np

from perception.codec.boxes import decode_boxes, encode_boxes
from perception.codec.outlined import add_outline
from perception.detector.finders import Finder
from perception.fusion.base import EncodeOptions, Fusion
from perception.fusion.detectors import shared_finder
from perception.fusion.one_pass import BoxForm
from perception.fusion.outline import outline, thinned
from perception.types import Boxes, clean_points
from swarm.errors import PayloadError
from swarm.geometry import Points

SENT_BOXES = 10
"""Best boxes of one scan that are sent, and how sure they must be: less than 500 bytes with the
outline."""
SENT_SCORE = 0.1
MAX_BOXES = 200
"""The most boxes that are taken: merging compares all pairs, so a payload of a few megabytes, each
box valid, would stop the ego."""


class LateFusion(BoxForm):
    """Boxes of all participants, merged where they overlap."""

    name = "late"
    shareable = True

    def __init__(self, finder: Finder) -> None:
        self.finder = finder

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The boxes detected in the scan, in the sensor's frame."""
        cloud = clean_points(points)
        boxes = self.finder.find(cloud)
        best = boxes.take(np.flatnonzero(boxes.scores >= SENT_SCORE)[:SENT_BOXES])
        return add_outline(encode_boxes(best), thinned(outline(cloud)))

    def read(self, payload: bytes) -> Boxes:
        """See `BoxForm.read`."""
        boxes = decode_boxes(payload)
        if len(boxes) > MAX_BOXES:
            raise PayloadError(f"{len(boxes)} boxes in one scan; allowed: {MAX_BOXES}")
        return boxes


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError for an unknown one."""
    return LateFusion(shared_finder(detector))
