"""Early fusion: robots send points; the ego merges them in its own frame, then detects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from perception.codec.points import decode_points, encode_points
from perception.detector import DetectorConfig, detect
from perception.fusion.base import Contribution, EncodeOptions, FusionResult
from perception.scene import ground_mask
from perception.types import clean_points
from swarm.errors import PerceptionError
from swarm.geometry import Matrix, Points, invert, transform


class EarlyFusion:
    """Points of all participants, detected as one cloud."""

    name = "early"

    def __init__(self, config: DetectorConfig) -> None:
        self._config = config

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The scan, without its ground unless asked otherwise, within the asked error."""
        cloud = clean_points(points)
        if not options.keep_ground:
            cloud = cloud[~ground_mask(cloud)]
        return encode_points(cloud, options.max_error_m)

    def fuse(
        self, own: Points, world_from_own: Matrix, contributions: Sequence[Contribution]
    ) -> FusionResult:
        """Merges the clouds in the ego's frame and detects on the whole."""
        clouds = [clean_points(own)]
        origins = [np.zeros(3)]
        rejected: dict[str, str] = {}
        own_from_world = invert(world_from_own)
        for item in contributions:
            try:
                points = decode_points(item.payload)
            except PerceptionError as error:
                rejected[item.robot] = str(error)
                continue
            own_from_sensor = own_from_world @ item.world_from_sensor
            clouds.append(clean_points(transform(own_from_sensor, points)))
            origins.append(own_from_sensor[:3, 3])
        boxes = detect(np.concatenate(clouds), self._config, np.stack(origins))
        return FusionResult(boxes.transformed(world_from_own), rejected)
