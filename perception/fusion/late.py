"""Late fusion: robots detect on their own and send boxes; the ego merges the boxes."""

from __future__ import annotations

import numpy as np

from perception.boxes import weighted_fusion
from perception.codec.boxes import decode_boxes, encode_boxes
from perception.detector import DetectorConfig, detect
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.participants import with_participants
from perception.types import Boxes, clean_points
from swarm.errors import PayloadError
from swarm.geometry import Matrix, Points

MAX_BOXES = 200
"""Best boxes of one scan that are sent, and the most that are taken: merging compares all pairs,
so a payload of a few megabytes, each box valid, would stop the ego."""


class LateFusion(Fusion):
    """Boxes of all participants, merged where they overlap."""

    name = "late"

    def __init__(self, config: DetectorConfig) -> None:
        self._config = config

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The boxes detected in the scan, in the sensor's frame."""
        boxes = detect(clean_points(points), self._config)
        return encode_boxes(boxes.take(np.arange(min(len(boxes), MAX_BOXES))))

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts with the boxes of the own scan."""
        return _MergedBoxes(self._config, own, world_from_own)


class _MergedBoxes(Gathering):
    """Boxes in the world frame, merged where they overlap."""

    def __init__(self, config: DetectorConfig, own: Points, world_from_own: Matrix) -> None:
        self._config = config
        self._world_from_own = world_from_own
        self._parts = [detect(clean_points(own), config).transformed(world_from_own)]
        self._senders: list[Matrix] = []

    def add(self, contribution: Contribution) -> None:
        boxes = decode_boxes(contribution.payload)
        if len(boxes) > MAX_BOXES:
            raise PayloadError(f"{len(boxes)} boxes in one scan; allowed: {MAX_BOXES}")
        self._parts.append(boxes.transformed(contribution.world_from_sensor))
        self._senders.append(contribution.world_from_sensor)

    def finish(self) -> Boxes:
        fused = weighted_fusion(Boxes.concatenate(self._parts))
        # The others see the ego; it does not report itself.
        from_ego = fused.centers[:, :2] - self._world_from_own[:2, 3]
        others = fused.take(np.hypot(*from_ego.T) > self._config.own_body_m)
        return with_participants(others, self._senders, self._config.carrier)
