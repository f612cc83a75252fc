"""Early fusion: robots send points; the ego merges them in its own frame, then detects."""

from __future__ import annotations

import numpy as np

from perception.codec.points import MAX_RANGE_M, decode_points, encode_points
from perception.detector import DetectorConfig, detect
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.participants import with_participants, without_bodies
from perception.scene import ground_mask
from perception.types import Boxes, clean_points
from swarm.geometry import Matrix, Points, invert, transform

MAX_POINTS = 300_000
"""A scan of 128 rings and 2,048 columns. A few kilobytes can announce millions of points, which
would hold up the frame of everybody."""


class EarlyFusion(Fusion):
    """Points of all participants, detected as one cloud."""

    name = "early"

    def __init__(self, config: DetectorConfig) -> None:
        self._config = config

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The scan, without its ground unless asked otherwise, within the asked error."""
        cloud = clean_points(points)
        if np.abs(cloud).max(initial=0.0) > MAX_RANGE_M:
            # A stray return must not cost the whole scan; the codec would refuse it.
            cloud = cloud[(np.abs(cloud) <= MAX_RANGE_M).all(axis=1)]
        if not options.keep_ground:
            cloud = cloud[~ground_mask(cloud)]
        return encode_points(cloud, options.max_error_m)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts the merged cloud with the own scan."""
        return _MergedCloud(self._config, own, world_from_own)


class _MergedCloud(Gathering):
    """Clouds in the ego's frame, detected as one."""

    def __init__(self, config: DetectorConfig, own: Points, world_from_own: Matrix) -> None:
        self._config = config
        self._world_from_own = world_from_own
        self._own_from_world = invert(world_from_own)
        self._clouds = [clean_points(own)]
        self._own_from_senders: list[Matrix] = []

    def add(self, contribution: Contribution) -> None:
        points = decode_points(contribution.payload, MAX_POINTS)
        own_from_sensor = self._own_from_world @ contribution.world_from_sensor
        self._clouds.append(clean_points(transform(own_from_sensor, points)))
        self._own_from_senders.append(own_from_sensor)

    def finish(self) -> Boxes:
        carrier = self._config.carrier
        cloud = without_bodies(np.concatenate(self._clouds), self._own_from_senders, carrier)
        origins = np.stack([np.zeros(3), *(sender[:3, 3] for sender in self._own_from_senders)])
        found = with_participants(
            detect(cloud, self._config, origins), self._own_from_senders, carrier
        )
        return found.transformed(self._world_from_own)
