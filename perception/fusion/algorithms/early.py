"""Early fusion: robots send points; the ego merges them in its own frame, then detects."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perception.codec.outlined import add_outline
from perception.codec.places import within
from perception.codec.points import MAX_RANGE_M, decode_points, encode_points
from perception.detector.finders import Finder
from perception.fusion.base import EncodeOptions, Fusion
from perception.fusion.detectors import shared_finder
from perception.fusion.one_pass import PointForm
from perception.fusion.outline import outline, thinned
from perception.scene import ground_mask
from perception.scene.clusters import may_be_objects
from perception.scene.structure import ground_and_structure, in_sectors
from perception.types import clean_points
from swarm.errors import PerceptionError
from swarm.geometry import Points, Pose, invert, transform

MAX_POINTS = 300_000
"""A scan of 128 rings and 2,048 columns. A few kilobytes can announce millions of points, which
would hold up the frame of everybody."""


MARGIN_M = 1.0
"""Beyond the detector's area that points are sent."""
DRIVEN_M = 5.0
"""How far an ego may have driven since it said where it was, to those who share a payload."""


class EarlyFusion(PointForm):
    """Points of all participants, detected as one cloud."""

    name = "early"
    shareable = True
    focuses = True

    def __init__(self, finder: Finder) -> None:
        self.finder = finder

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The scan within the asked error; unless asked otherwise without its ground, and with
        little of what else is no object where the detector needs no more, or nothing of it where
        the ego wants objects only.

        Where the ego says where it is, without what lies outside of its detector's area: that finds
        nothing there. Where several do, without what lies outside of all of their areas. Where it
        asks about places, only what lies there, without an outline where the ego says so. Raises
        PerceptionError where it asks about places and does not say where it is.
        """
        cloud = clean_points(points)
        reach = np.abs(cloud)
        if reach.max(initial=0.0) > MAX_RANGE_M:
            # A stray return must not cost the whole scan; the codec would refuse it.
            cloud = cloud[(reach <= MAX_RANGE_M).all(axis=1)]
        ground, wanted = self._wanted(cloud, options.objects_only and not options.demand)
        bare = bool(options.demand) and options.without_outline
        places = np.zeros((0, 2)) if bare else thinned(outline(cloud, ground))
        if not options.keep_ground:
            cloud = cloud.compress(wanted, axis=0)
        if options.reference is not None and options.pose is not None:
            ego_from_sensor = invert(options.reference.matrix()) @ options.pose.matrix()
            seen = transform(ego_from_sensor, cloud)
            of_use = self._of_use(seen)
            if options.demand:
                of_use &= within(options.demand, seen)
            cloud = cloud.compress(of_use, axis=0)
        elif options.demand:
            raise PerceptionError("places are asked about without where the ego is")
        if options.egos and options.pose is not None:
            cloud = self._of_use_to_any(cloud, options.pose, options.egos)
        return add_outline(encode_points(cloud, options.max_error_m), places)

    def _wanted(
        self, cloud: Points, objects_only: bool
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which points are ground, and which are worth sending: bool (N,) each. Of structure only
        some directions are, where a learned detector does with that; clusters, which are found
        where nothing is learnt, would take these for posts."""
        config = self.finder.config
        if self.finder.area is None or not config.sparse_structure:
            ground = ground_mask(cloud)
            return ground, ~ground
        ground, structure = ground_and_structure(cloud, config.tallest_m)
        if objects_only:
            return ground, ~ground & may_be_objects(cloud, structure, config.limits)
        wanted = ~ground
        wanted[structure] = in_sectors(cloud.compress(structure, axis=0))
        return ground, wanted

    def _of_use_to_any(self, cloud: Points, pose: Pose, egos: tuple[Pose, ...]) -> Points:
        """The points near enough to one of the egos, whichever way it looks by now."""
        area = self.finder.area
        if area is None:
            return cloud
        world = transform(pose.matrix(), cloud)
        reach_m = math.hypot(area.half_x_m, area.half_y_m) + MARGIN_M + DRIVEN_M
        inside = np.zeros(len(cloud), dtype=np.bool_)
        for ego in egos:
            x, y, z = (world - np.array([ego.x, ego.y, ego.z], dtype=world.dtype)).T
            near = x * x + y * y <= reach_m * reach_m
            tilt_m = reach_m * (abs(ego.roll) + abs(ego.pitch))
            near &= (z >= area.low_z_m - MARGIN_M - tilt_m) & (
                z <= area.high_z_m + MARGIN_M + tilt_m
            )
            inside |= near
        return cloud.compress(inside, axis=0)

    def _of_use(self, cloud: Points) -> NDArray[np.bool_]:
        """Which points in the ego's frame are in the area that its detector looks at, or a little
        around it: poses may be off."""
        area = self.finder.area
        if area is None:
            return np.ones(len(cloud), dtype=np.bool_)
        x, y, z = cloud.T
        inside: NDArray[np.bool_] = (np.abs(x) <= area.half_x_m + MARGIN_M) & (
            np.abs(y) <= area.half_y_m + MARGIN_M
        )
        inside &= (z >= area.low_z_m - MARGIN_M) & (z <= area.high_z_m + MARGIN_M)
        return inside

    def read(self, payload: bytes) -> Points:
        """See `PointForm.read`."""
        return decode_points(payload, MAX_POINTS)


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError for an unknown one."""
    return EarlyFusion(shared_finder(detector))
