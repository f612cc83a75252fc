"""Early fusion: robots send points; the ego merges them in its own frame, then detects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.codec.landmarks import add_landmarks, take_landmarks
from perception.codec.points import MAX_RANGE_M, encode_points
from perception.detector.finders import Finder
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.detectors import shared_finder
from perception.fusion.landmarks import correct
from perception.fusion.participants import with_participants, without_own
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
        """The scan, without its ground unless asked otherwise, within the asked error, and the
        landmarks that the robot sees in it."""
        cloud = clean_points(points)
        if np.abs(cloud).max(initial=0.0) > MAX_RANGE_M:
            # A stray return must not cost the whole scan; the codec would refuse it.
            cloud = cloud[(np.abs(cloud) <= MAX_RANGE_M).all(axis=1)]
        landmarks = self._finder.landmarks(cloud)
        if not options.keep_ground:
            cloud = cloud[~ground_mask(cloud)]
        return add_landmarks(encode_points(cloud, options.max_error_m), landmarks)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts the merged cloud with the own scan."""
        return _MergedCloud(
            self._finder, own, world_from_own, self.corrects and self._finder.aligns
        )


class _MergedCloud(Gathering):
    """Clouds in the ego's frame, detected as one."""

    def __init__(self, finder: Finder, own: Points, world_from_own: Matrix, corrects: bool) -> None:
        self._finder = finder
        self._corrects = corrects
        self._own_landmarks: NDArray[np.float64] | None = None
        self._world_from_own = world_from_own
        self._own_from_world = invert(world_from_own)
        self._clouds = [clean_points(own)]
        self._own_from_senders: list[Matrix] = []

    def prepare(self) -> None:
        if self._corrects and self._own_landmarks is None:
            self._own_landmarks = self._finder.landmarks(self._clouds[0])

    def add(self, contribution: Contribution) -> None:
        points, landmarks = take_landmarks(contribution.payload, MAX_POINTS)
        own_from_sensor = self._own_from_world @ contribution.world_from_sensor
        if self._corrects:
            self.prepare()
            assert self._own_landmarks is not None
            found = correct(
                self._own_landmarks,
                landmarks @ own_from_sensor[:2, :2].T + own_from_sensor[:2, 3],
                own_from_sensor,
                np.array(self._finder.config.carrier.center[:2]),
            )
            own_from_sensor = found.corrected_from_claimed @ own_from_sensor
        self._clouds.append(clean_points(transform(own_from_sensor, points)))
        self._own_from_senders.append(own_from_sensor)

    def finish(self) -> Boxes:
        found = self._finder.find(np.concatenate(self._clouds), self._own_from_senders)
        found = without_own(found, self._finder.config.own_body_m)
        found = with_participants(found, self._own_from_senders, self._finder.config.carrier)
        return found.transformed(self._world_from_own)


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError for an unknown one."""
    return EarlyFusion(shared_finder(detector))
