"""Small worlds whose scans a test chooses, and robots in them."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from prometheus_client import CollectorRegistry

from perception.fusion.registry import fusion_names
from perception.types import Boxes
from robot_agent.agent import RobotAgent
from robot_agent.encoder import Encoder
from robot_agent.metrics import RobotMetrics
from swarm.errors import WorldError
from swarm.geometry import Points, Pose
from swarm.log import make_logger
from swarm.process import Clock
from worlds.base import GroundTruth, Scan


def room(frame: int = 0) -> Points:
    """Level ground, and two blocks upon it; another noise in every frame."""
    noise = np.random.default_rng(frame)
    ground = np.column_stack([noise.uniform(-15, 15, (4000, 2)), noise.normal(-1.0, 0.01, 4000)])
    blocks = [noise.uniform(low, np.add(low, (0.9, 0.6, 1.2)), (300, 3)) for low in BLOCKS]
    return np.concatenate([ground, *blocks]).astype(np.float32)


BLOCKS = ((5.0, 1.0, -0.95), (-6.0, -4.0, -0.95))


class ChosenWorld:
    """A world whose points a function of the frame gives; it may raise WorldError."""

    name = "chosen"
    rate_hz = 10.0
    frame_count = 10
    range_m = 20.0
    detector = "factory"

    def __init__(
        self, points: Callable[[int], Points] = room, robots: tuple[str, ...] = ("R1",)
    ) -> None:
        self.robots = robots
        self._points = points

    def pose(self, robot: str, frame: int) -> Pose:
        if robot not in self.robots:
            raise WorldError(f"robot {robot!r} is not one of {self.robots}")
        return Pose(float(self.robots.index(robot)), 2.0, 1.0, yaw=0.5)

    def scan(self, robot: str, frame: int) -> Scan:
        return Scan(robot, frame, self._points(frame), self.pose(robot, frame), (1.0, 0.0, 0.0))

    def ground_truth(self, frame: int) -> GroundTruth:
        return GroundTruth(Boxes.empty(), (), np.zeros(0, dtype=np.int64))


class Robot:
    """A robot agent on a registry of its own."""

    def __init__(
        self,
        world: ChosenWorld,
        *,
        clock: Clock | None = None,
        ring_frames: int = 10,
        size_period_s: float = 3600.0,
    ) -> None:
        self.registry = CollectorRegistry()
        self._detector = world.detector
        self.epoch_ns = time.time_ns()
        metrics = RobotMetrics(self.registry)
        self.agent = RobotAgent(
            world,
            world.robots[0],
            instance=1,
            epoch_ns=self.epoch_ns,
            encoder=Encoder(world.detector, metrics),
            clock=clock or Clock(),
            metrics=metrics,
            log=make_logger("test", level="error"),
            ring_frames=ring_frames,
            size_period_s=size_period_s,
        )

    def sense(self, frames: int = 1) -> None:
        """Waits for new frames of the world and takes them."""
        taken = 0
        while taken < frames:
            if self.agent.sensor.sense():
                taken += 1
            else:
                time.sleep(self.agent.sensor.next_frame_in_s())

    def measure_all(self) -> None:
        """Measures until every algorithm has a size."""
        for _ in fusion_names(self._detector):
            self.agent.measure()

    def encoded(self) -> float:
        """Payloads that were encoded so far, of all algorithms."""
        name = "coadapt_robot_encode_seconds_count"
        return sum(self.value(name, algorithm=a) for a in fusion_names(self._detector))

    def value(self, name: str, **labels: str) -> float:
        return self.registry.get_sample_value(name, labels) or 0.0
