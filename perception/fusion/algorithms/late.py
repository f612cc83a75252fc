"""Late fusion: robots detect on their own and send boxes; the ego merges the boxes."""

from __future__ import annotations

import numpy as np

from perception.boxes import weighted_fusion
from perception.codec.boxes import decode_boxes, encode_boxes
from perception.codec.outlined import add_outline, take_outline
from perception.detector.finders import Finder
from perception.fusion.aligner import Aligner, corrected, in_world
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.detectors import shared_finder
from perception.fusion.known import without_own
from perception.fusion.outline import outline, thinned
from perception.types import Boxes, clean_points
from swarm.errors import PayloadError
from swarm.geometry import Matrix, Points, invert

SENT_BOXES = 10
"""Best boxes of one scan that are sent, and how sure they must be: less than 500 bytes with the
outline."""
SENT_SCORE = 0.1
MAX_BOXES = 200
"""The most boxes that are taken: merging compares all pairs, so a payload of a few megabytes, each
box valid, would stop the ego."""


class LateFusion(Fusion):
    """Boxes of all participants, merged where they overlap."""

    name = "late"
    shareable = True

    def __init__(self, finder: Finder) -> None:
        self._finder = finder

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The boxes detected in the scan, in the sensor's frame."""
        cloud = clean_points(points)
        boxes = self._finder.find(cloud)
        best = boxes.take(np.flatnonzero(boxes.scores >= SENT_SCORE)[:SENT_BOXES])
        return add_outline(encode_boxes(best), thinned(outline(cloud)))

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts with the boxes of the own scan."""
        aligner = Aligner(own) if self.corrects else None
        return _MergedBoxes(self._finder, own, world_from_own, aligner)


class _MergedBoxes(Gathering):
    """Boxes in the ego's frame, merged where they overlap."""

    def __init__(
        self, finder: Finder, own: Points, world_from_own: Matrix, aligner: Aligner | None
    ) -> None:
        self._config = finder.config
        self._aligner = aligner
        self._world_from_own = world_from_own
        self._own_from_world = invert(world_from_own)
        self._finder = finder
        self._points = own
        self._own: Boxes | None = None
        self._parts: list[Boxes] = []
        self._robots: list[str] = []
        self._senders: list[Matrix] = []

    def prepare(self) -> None:
        if self._aligner is not None:
            self._aligner.prepare()
        if self._own is None:
            self._own = self._finder.find(clean_points(self._points))

    def add(self, contribution: Contribution) -> None:
        payload, places = take_outline(contribution.payload)
        boxes = decode_boxes(payload)
        if len(boxes) > MAX_BOXES:
            raise PayloadError(f"{len(boxes)} boxes in one scan; allowed: {MAX_BOXES}")
        own_from_sensor = self._own_from_world @ contribution.world_from_sensor
        if self._aligner is not None:
            self._aligner.add(places, own_from_sensor)
        self._parts.append(boxes)
        self._senders.append(own_from_sensor)
        self._robots.append(contribution.robot)

    def finish(self) -> Boxes:
        self.prepare()
        assert self._own is not None
        senders = corrected(self._senders, self._aligner)
        others = [
            boxes.transformed(sender) for sender, boxes in zip(senders, self._parts, strict=True)
        ]
        fused = weighted_fusion(Boxes.concatenate([self._own, *others]))
        fused = without_own(fused, self._config.own_body_m, self.stood_at)
        return fused.transformed(self._world_from_own)

    def corrections(self) -> dict[str, Matrix]:
        return in_world(self._aligner, self._robots, self._world_from_own)


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError for an unknown one."""
    return LateFusion(shared_finder(detector))
