"""Robots that are not quite where they believe to be: errors of localisation."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swarm.body import Body
from swarm.geometry import Pose
from worlds.base import GroundTruth, Scan, World, body_of, comm_range_of

PoseErrors = Literal["anew", "drifting", "fixed"]
"""How long what poses err by lasts."""
DRIFT_FRAMES = 50


def disturbed(
    pose: Pose,
    robot: str,
    frame: int,
    sigma: float,
    errors: PoseErrors = "anew",
    run: int = 0,
) -> Pose:
    """Where a robot believes that its sensor is: off by `sigma` metres and degrees (standard
    deviation). Anew in each frame, drawn from (robot, frame) alone; or, drawn from (robot, run),
    fixed, or drifting from one draw to the next in DRIFT_FRAMES."""
    if sigma == 0.0:
        return pose
    if errors == "anew":
        error = _drawn(sigma, frame, *robot.encode())
    else:
        at, along = divmod(frame, DRIFT_FRAMES) if errors == "drifting" else (0, 0)
        angle = math.pi / 2 * along / DRIFT_FRAMES
        # Sine and cosine keep the standard deviation on the way.
        first, second = (_drawn(sigma, run, at + i, *robot.encode()) for i in (0, 1))
        error = math.cos(angle) * first + math.sin(angle) * second
    x, y, turn = error.tolist()
    return Pose(
        pose.x + x, pose.y + y, pose.z, pose.roll, pose.pitch, pose.yaw + math.radians(turn)
    )


def _drawn(sigma: float, *key: int) -> NDArray[np.float64]:
    """x, y and turn (3,)."""
    return np.random.default_rng(key).normal(0.0, sigma, 3)


class Mislocalised:
    """A world whose robots err about where they are, by errors that drift; what is there is as it
    is."""

    def __init__(self, world: World, sigma: float, run: int = 0) -> None:
        """`sigma`, `run`: see `disturbed`."""
        self.name = world.name
        self.robots = world.robots
        self.rate_hz = world.rate_hz
        self.frame_count = world.frame_count
        self.range_m = world.range_m
        self.detector = world.detector
        self.comm_range_m = comm_range_of(world)
        self._world = world
        self._sigma = sigma
        self._run = run

    def body(self, robot: str) -> Body:
        """See `Embodied.body`."""
        return body_of(self._world, robot)

    def pose(self, robot: str, frame: int) -> Pose:
        """See `World.pose`; where the robot believes to be."""
        return self._believed(self._world.pose(robot, frame), robot, frame)

    def scan(self, robot: str, frame: int) -> Scan:
        """See `World.scan`."""
        scan = self._world.scan(robot, frame)
        return replace(scan, pose=self._believed(scan.pose, robot, frame))

    def ground_truth(self, frame: int) -> GroundTruth:
        """See `World.ground_truth`."""
        return self._world.ground_truth(frame)

    def _believed(self, pose: Pose, robot: str, frame: int) -> Pose:
        return disturbed(pose, robot, frame, self._sigma, "drifting", self._run)
