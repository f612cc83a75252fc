"""Early fusion: robots send points; the ego merges them in its own frame, then detects."""

from __future__ import annotations

import numpy as np

from perception.codec.outlined import add_outline, take_outline
from perception.codec.points import MAX_RANGE_M, decode_points, encode_points
from perception.detector.finders import Finder
from perception.fusion.aligner import Aligner, corrected, in_world
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.detectors import shared_finder
from perception.fusion.known import without_own
from perception.fusion.outline import outline, thinned
from perception.scene import ground_mask
from perception.types import Boxes, clean_points
from swarm.geometry import Matrix, Points, invert, transform

MAX_POINTS = 300_000
"""A scan of 128 rings and 2,048 columns. A few kilobytes can announce millions of points, which
would hold up the frame of everybody."""


class EarlyFusion(Fusion):
    """Points of all participants, detected as one cloud."""

    name = "early"

    def __init__(self, finder: Finder) -> None:
        self._finder = finder

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The scan, without its ground unless asked otherwise, within the asked error."""
        cloud = clean_points(points)
        reach = np.abs(cloud)
        if reach.max(initial=0.0) > MAX_RANGE_M:
            # A stray return must not cost the whole scan; the codec would refuse it.
            cloud = cloud[(reach <= MAX_RANGE_M).all(axis=1)]
        ground = ground_mask(cloud)
        places = thinned(outline(cloud, ground))
        if not options.keep_ground:
            cloud = cloud.compress(~ground, axis=0)
        return add_outline(encode_points(cloud, options.max_error_m), places)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts the merged cloud with the own scan."""
        aligner = Aligner(own) if self.corrects else None
        return _MergedCloud(self._finder, own, world_from_own, aligner)


class _MergedCloud(Gathering):
    """Clouds in the ego's frame, detected as one."""

    def __init__(
        self, finder: Finder, own: Points, world_from_own: Matrix, aligner: Aligner | None
    ) -> None:
        self._finder = finder
        self._aligner = aligner
        self._world_from_own = world_from_own
        self._own_from_world = invert(world_from_own)
        self._own = own
        self._clouds: list[Points] = []
        self._robots: list[str] = []
        """Of each cloud: who sent it."""
        self._senders: list[Matrix] = []
        """Of each cloud: its sensor in the ego's frame, as it was told."""

    def prepare(self) -> None:
        if self._aligner is not None:
            self._aligner.prepare()

    def add(self, contribution: Contribution) -> None:
        payload, places = take_outline(contribution.payload)
        points = decode_points(payload, MAX_POINTS)
        own_from_sensor = self._own_from_world @ contribution.world_from_sensor
        if self._aligner is not None:
            self._aligner.add(places, own_from_sensor)
        self._clouds.append(points)
        self._senders.append(own_from_sensor)
        self._robots.append(contribution.robot)

    def finish(self) -> Boxes:
        senders = corrected(self._senders, self._aligner)
        others = [
            clean_points(transform(sender, cloud))
            for sender, cloud in zip(senders, self._clouds, strict=True)
        ]
        merged = np.concatenate([clean_points(self._own), *others])
        found = self._finder.find(merged, senders)
        found = without_own(found, self._finder.config.own_body_m, self.stood_at)
        return found.transformed(self._world_from_own)

    def corrections(self) -> dict[str, Matrix]:
        return in_world(self._aligner, self._robots, self._world_from_own)


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError for an unknown one."""
    return EarlyFusion(shared_finder(detector))
