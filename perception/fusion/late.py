"""Late fusion: robots detect on their own and send boxes; the ego merges the boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from perception.boxes import weighted_fusion
from perception.codec.boxes import decode_boxes, encode_boxes
from perception.detector import DetectorConfig, detect
from perception.fusion.base import Contribution, EncodeOptions, FusionResult
from perception.types import Boxes, clean_points
from swarm.errors import PerceptionError
from swarm.geometry import Matrix, Points


class LateFusion:
    """Boxes of all participants, merged where they overlap."""

    name = "late"

    def __init__(self, config: DetectorConfig) -> None:
        self._config = config

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The boxes detected in the scan, in the sensor's frame."""
        return encode_boxes(detect(clean_points(points), self._config))

    def fuse(
        self, own: Points, world_from_own: Matrix, contributions: Sequence[Contribution]
    ) -> FusionResult:
        """Merges the senders' boxes with those of the own scan."""
        parts = [detect(clean_points(own), self._config).transformed(world_from_own)]
        rejected: dict[str, str] = {}
        for item in contributions:
            try:
                parts.append(decode_boxes(item.payload).transformed(item.world_from_sensor))
            except PerceptionError as error:
                rejected[item.robot] = str(error)
        boxes = weighted_fusion(Boxes.concatenate(parts))
        # The others see the ego; it does not report itself.
        from_ego = boxes.centers[:, :2] - world_from_own[:2, 3]
        others = np.hypot(*from_ego.T) > self._config.own_body_m
        return FusionResult(boxes.take(others), rejected)
