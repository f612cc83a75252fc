"""Sensing: the newest frame of the world into the ring of one robot."""

from __future__ import annotations

import math
import time

from robot_agent.frames import Frame, Ring
from robot_agent.metrics import RobotMetrics
from swarm.errors import SilentError, WorldError
from swarm.log import Logger
from swarm.process import Clock, capture_ns, frame_now
from worlds.base import Scan, World


class Sensor:
    """Takes the scans of one robot; a late one skips frames, newest first.

    The frame is chosen by the machine's clock, as the world's time is one; its capture time is
    told by the robot's clock, which may be off.
    """

    def __init__(
        self,
        world: World,
        robot: str,
        ring: Ring,
        *,
        epoch_ns: int,
        clock: Clock,
        metrics: RobotMetrics,
        log: Logger,
    ) -> None:
        self._world = world
        self._robot = robot
        self._ring = ring
        self._epoch_ns = epoch_ns
        self._clock = clock
        self._metrics = metrics
        self._log = log
        self._last: int | None = None
        self._failing = False

    def sense(self) -> bool:
        """Takes the newest frame if it was not taken yet; False when there is none to take.

        A frame that the world cannot give is counted, logged once in a row, and left out; a live
        sensor's silence makes the robot forget what it saw, too. A live sensor that is slower than
        frames are leaves some without a scan.
        """
        frame = frame_now(self._epoch_ns, self._world.rate_hz, time.time_ns())
        if frame == self._last:
            return False
        if self._last is not None and frame > self._last + 1:
            self._metrics.skipped.labels(self._robot).inc(frame - self._last - 1)
        self._last = frame
        begun = time.perf_counter()
        try:
            scan = checked(self._world.scan(self._robot, frame))
        except WorldError as error:
            self._metrics.unreadable.labels(self._robot).inc()
            if isinstance(error, SilentError):
                self._ring.clear()
            if not self._failing:
                self._log.warning("scan_unreadable", frame=frame, error=str(error)[:300])
            self._failing = True
            return True
        if self._failing:
            self._log.info("scan_readable_again", frame=frame)
        self._failing = False
        captured = scan.captured_ns
        if captured is None:
            captured = capture_ns(self._epoch_ns, self._world.rate_hz, frame)
        told = max(0, captured + self._clock.offset_ns)
        newest = self._ring.newest()
        if scan.captured_ns is not None and newest is not None and newest.capture_ns == told:
            return True
        self._metrics.scan_seconds.observe(time.perf_counter() - begun)
        self._metrics.scans.labels(self._robot).inc()
        self._ring.push(Frame(scan, frame, told))
        return True

    def rest(self) -> None:
        """Begins anew with the next frame: those that pass meanwhile are not missed."""
        self._last = None

    def next_frame_in_s(self) -> float:
        """Seconds until a frame is captured that was not taken yet; 0 when it is there. At most
        what one frame takes: the clock may have been put back since the last one was taken."""
        due = capture_ns(self._epoch_ns, self._world.rate_hz, (self._last or 0) + 1)
        return max(0.0, min(1.0 / self._world.rate_hz, (due - time.time_ns()) / 1e9))


def checked(scan: Scan) -> Scan:
    """The scan, if it has a finite pose and velocity and a cloud (N, 3); its points may be NaN.

    Raises WorldError for another one.
    """
    if scan.points.ndim != 2 or scan.points.shape[1] != 3:
        raise WorldError(
            f"scan of {scan.robot!r} in frame {scan.frame} has points of shape "
            f"{scan.points.shape}; it must be (N, 3)"
        )
    if not all(map(math.isfinite, (*scan.pose.as_tuple(), *scan.velocity))):
        raise WorldError(
            f"scan of {scan.robot!r} in frame {scan.frame} has pose {scan.pose.as_tuple()} and "
            f"velocity {scan.velocity}; all must be finite"
        )
    return scan
