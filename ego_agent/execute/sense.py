"""The ego's own senses: its scan straight from the world, never over the link."""

from __future__ import annotations

import random
import time
from dataclasses import dataclass

import numpy as np

from ego_agent.monitor.snapshot import Monitor
from perception.types import clean_points
from sensing.telling import Teller
from swarm.errors import CoAdaptError
from swarm.geometry import Matrix, Points, Pose
from swarm.log import Logger
from swarm.messages import Beacon
from swarm.process import Clock, capture_ns, frame_now
from worlds.base import World

SCENE_PERIOD_S = 0.5
"""The ego describes its scan as often as the robots do theirs."""


@dataclass(frozen=True, slots=True)
class OwnFrame:
    """The ego's part of one frame."""

    frame: int
    capture_ns: int
    points: Points
    """float32 (N, 3), finite, sensor frame; empty when the scan could not be read."""
    pose: Pose
    velocity: tuple[float, float, float]
    failure: str
    """Why the scan could not be read; empty when it could."""

    @property
    def world_from_sensor(self) -> Matrix:
        """4x4 transform of the points to the world frame."""
        return self.pose.matrix()


class OwnSensor:
    """Reads and describes the ego's own scans and tells Monitor.

    `read` belongs to the asking thread, `describe` to the fusing one, `locate` to the control
    cycle.
    """

    def __init__(
        self, world: World, ego: str, epoch_ns: int, monitor: Monitor, clock: Clock, log: Logger
    ) -> None:
        self.rate_hz = world.rate_hz
        self._world = world
        self._ego = ego
        self._epoch_ns = epoch_ns
        self._monitor = monitor
        self._clock = clock
        self._log = log
        self._teller = Teller(world, ego, random.getrandbits(48), clock.now_ns)
        self._described_at = float("-inf")
        self._failing = False

    def newest(self) -> int:
        """The newest frame that the ego's sensor has captured by now."""
        return frame_now(self._epoch_ns, self.rate_hz, self._clock.now_ns())

    def until(self, frame: int) -> float:
        """Seconds until a frame is captured; not positive when it has been."""
        return (capture_ns(self._epoch_ns, self.rate_hz, frame) - self._clock.now_ns()) * 1e-9

    def age_s(self, own: OwnFrame) -> float:
        """Seconds since a frame was captured."""
        return (self._clock.now_ns() - own.capture_ns) * 1e-9

    def locate(self) -> None:
        """Tells Monitor where the ego is now, whatever the frames' threads are busy with."""
        frame = self.newest()
        pose = self._pose(frame)
        if pose is not None:
            self._monitor.note_own(self._beacon(self._blind(frame, pose, "")))

    def read(self, frame: int) -> OwnFrame | None:
        """The ego's scan and pose, which Monitor learns too.

        An unreadable scan becomes an empty cloud with the reason; None when not even the pose is
        known, so that nothing can be fused.
        """
        captured = capture_ns(self._epoch_ns, self.rate_hz, frame)
        try:
            scan = self._world.scan(self._ego, frame)
            taken = captured if scan.captured_ns is None else scan.captured_ns
            own = OwnFrame(frame, taken, clean_points(scan.points), scan.pose, scan.velocity, "")
        except (CoAdaptError, OSError) as error:
            pose = self._pose(frame)
            if not self._failing:
                self._log.error("own_scan_unreadable", frame=frame, error=str(error))
            self._failing = True
            if pose is None:
                return None
            own = self._blind(frame, pose, str(error))
        else:
            self._failing = False
        self._monitor.note_own(self._beacon(own))
        return own

    def describe(self, own: OwnFrame) -> None:
        """Tells Monitor what the ego sees, at most every half second."""
        now = time.monotonic()
        if now - self._described_at < SCENE_PERIOD_S or own.failure:
            return
        self._described_at = now
        scene = self._teller.description(own.frame, own.capture_ns, own.pose, own.points)
        self._monitor.note_own(self._beacon(own), scene)

    def _beacon(self, own: OwnFrame) -> Beacon:
        return self._teller.beacon(own.frame, own.capture_ns, own.pose, own.velocity, {})

    def _blind(self, frame: int, pose: Pose, failure: str) -> OwnFrame:
        captured = capture_ns(self._epoch_ns, self.rate_hz, frame)
        nothing = np.zeros((0, 3), dtype=np.float32)
        return OwnFrame(frame, captured, nothing, pose, (0.0, 0.0, 0.0), failure)

    def _pose(self, frame: int) -> Pose | None:
        try:
            return self._world.pose(self._ego, frame)
        except (CoAdaptError, OSError):
            return None
