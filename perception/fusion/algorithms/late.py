"""Late fusion: robots detect on their own and send boxes; the ego merges the boxes."""

from __future__ import annotations

import numpy as np

from perception.boxes import weighted_fusion
from perception.codec.boxes import decode_boxes, encode_boxes
from perception.detector.finders import Finder
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.detectors import shared_finder
from perception.fusion.landmarks import correct, of_boxes
from perception.fusion.participants import with_participants
from perception.types import Boxes, clean_points
from swarm.errors import PayloadError
from swarm.geometry import Matrix, Points, invert

SENT_BOXES = 20
"""Best boxes of one scan that are sent, and how sure they must be: about 500 bytes."""
SENT_SCORE = 0.1
MAX_BOXES = 200
"""The most boxes that are taken: merging compares all pairs, so a payload of a few megabytes, each
box valid, would stop the ego."""


class LateFusion(Fusion):
    """Boxes of all participants, merged where they overlap."""

    name = "late"

    def __init__(self, finder: Finder) -> None:
        self._finder = finder

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The boxes detected in the scan, in the sensor's frame."""
        boxes = self._finder.find(clean_points(points))
        return encode_boxes(boxes.take(np.flatnonzero(boxes.scores >= SENT_SCORE)[:SENT_BOXES]))

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts with the boxes of the own scan."""
        return _MergedBoxes(
            self._finder, own, world_from_own, self.corrects and self._finder.aligns
        )


class _MergedBoxes(Gathering):
    """Boxes in the world frame, merged where they overlap."""

    def __init__(self, finder: Finder, own: Points, world_from_own: Matrix, corrects: bool) -> None:
        self._config = finder.config
        self._corrects = corrects
        self._world_from_own = world_from_own
        self._finder = finder
        self._points = own
        self._own: Boxes | None = None
        self._parts: list[Boxes] = []
        self._senders: list[Matrix] = []

    def prepare(self) -> None:
        if self._own is None:
            found = self._finder.find(clean_points(self._points))
            self._own = found.transformed(self._world_from_own)

    def add(self, contribution: Contribution) -> None:
        boxes = decode_boxes(contribution.payload)
        if len(boxes) > MAX_BOXES:
            raise PayloadError(f"{len(boxes)} boxes in one scan; allowed: {MAX_BOXES}")
        world_from_sensor = contribution.world_from_sensor
        if self._corrects:
            world_from_sensor = self._corrected(boxes, world_from_sensor)
        self._parts.append(boxes.transformed(world_from_sensor))
        self._senders.append(world_from_sensor)

    def _corrected(self, boxes: Boxes, world_from_sensor: Matrix) -> Matrix:
        self.prepare()
        assert self._own is not None
        own_from_world = invert(self._world_from_own)
        own_from_sender = own_from_world @ world_from_sensor
        found = correct(
            of_boxes(self._own.transformed(own_from_world)),
            of_boxes(boxes.transformed(own_from_sender)),
            own_from_sender,
            np.array(self._config.carrier.center[:2]),
        )
        return self._world_from_own @ found.corrected_from_claimed @ own_from_sender

    def finish(self) -> Boxes:
        self.prepare()
        assert self._own is not None
        fused = weighted_fusion(Boxes.concatenate([self._own, *self._parts]))
        # The others see the ego; it does not report itself.
        from_ego = fused.centers[:, :2] - self._world_from_own[:2, 3]
        others = fused.take(np.hypot(*from_ego.T) > self._config.own_body_m)
        return with_participants(others, self._senders, self._config.carrier)


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError for an unknown one."""
    return LateFusion(shared_finder(detector))
