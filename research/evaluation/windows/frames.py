"""A world that computes each scan and each truth once."""

from __future__ import annotations

from functools import cache

from swarm.geometry import Pose
from worlds.base import GroundTruth, Scan, World


class OnceWorld:
    """A world whose scans and truths stay in memory: for a few frames of many robots."""

    def __init__(self, world: World) -> None:
        self.name = world.name
        self.robots = world.robots
        self.rate_hz = world.rate_hz
        self.frame_count = world.frame_count
        self.range_m = world.range_m
        self.detector = world.detector
        self._world = world
        self._scan = cache(world.scan)
        self._truth = cache(world.ground_truth)

    def pose(self, robot: str, frame: int) -> Pose:
        """See `World.pose`."""
        return self._world.pose(robot, frame)

    def scan(self, robot: str, frame: int) -> Scan:
        """See `World.scan`."""
        return self._scan(robot, frame)

    def ground_truth(self, frame: int) -> GroundTruth:
        """See `World.ground_truth`."""
        return self._truth(frame)
