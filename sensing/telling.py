"""What a robot tells of itself: beacons, and descriptions of what it sees."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping

import numpy as np

from perception.detector import configuration
from perception.scene import describe, to_array, visible_range
from swarm.arrays import pack
from swarm.geometry import Points, Pose
from swarm.messages import Beacon, SceneDescription
from swarm.version import installed_version
from worlds.base import World, body_of

SECTORS = 72
"""Sectors of 5 degrees in a scene description."""


class Teller:
    """Makes one robot's messages, each kind with numbers of its own."""

    def __init__(
        self,
        world: World,
        robot: str,
        instance: int,
        now_ns: Callable[[], int],
        mark: str = "",
    ) -> None:
        """`instance` tells this start of the robot from others; `now_ns` is its clock, `mark` that
        of its world (`sensing.mark`)."""
        self.robot = robot
        self._mark = mark
        self.instance = instance
        self._range_m = world.range_m
        self._body = body_of(world, robot)
        self._own_body_m = configuration(world.detector).own_body_m
        self._now_ns = now_ns
        self._beacons = itertools.count(1)
        self._scenes = itertools.count(1)

    def beacon(
        self,
        frame: int,
        capture_ns: int,
        pose: Pose,
        velocity: tuple[float, float, float],
        sizes: Mapping[str, int],
        steady_ns: int = 0,
    ) -> Beacon:
        """Where the robot is, and how many bytes each algorithm's observation takes.

        `pose` is the sensor's in the world frame, `velocity` in the world frame in m/s.
        """
        return Beacon(
            robot=self.robot,
            instance=self.instance,
            seq=next(self._beacons),
            sent_ns=self._now_ns(),
            steady_ns=steady_ns,
            capture_ns=capture_ns,
            frame=frame,
            pose=pose.as_tuple(),
            velocity=velocity,
            range_m=self._range_m,
            body=self._body,
            sizes=dict(sizes),
            world=self._mark,
            software=installed_version(),
        )

    def description(
        self, frame: int, capture_ns: int, pose: Pose, points: Points
    ) -> SceneDescription:
        """The objects in a scan and how far it sees; `points` are float32 (N, 3), sensor frame.

        Raises PerceptionError when the scan cannot be described.
        """
        begun = time.perf_counter()
        scene = describe(points, own_body_m=self._own_body_m)
        seen = visible_range(points, SECTORS, pose.heading, self._own_body_m)
        elapsed_s = time.perf_counter() - begun
        return SceneDescription(
            robot=self.robot,
            instance=self.instance,
            seq=next(self._scenes),
            sent_ns=self._now_ns(),
            capture_ns=capture_ns,
            frame=frame,
            pose=pose.as_tuple(),
            objects=pack(to_array(scene, pose.matrix())),
            visible_m=pack(np.asarray(seen, dtype=np.float32).reshape(-1, 1)),
            ground_points=scene.ground_points,
            elapsed_ms=elapsed_s * 1e3,
        )
