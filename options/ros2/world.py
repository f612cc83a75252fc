"""One live robot as a world: nothing in it is older than it says."""

from __future__ import annotations

import struct
import threading
import time
from dataclasses import dataclass, replace

import numpy as np

from options.ros.cdr import CdrError
from options.ros.frames import FIXED, plain
from options.ros.messages import (
    CLOUD,
    ODOMETRY,
    STAMP_BYTES,
    TRANSFORMS,
    read_cloud,
    read_frame,
    read_stamp,
)
from options.ros2.address import Address
from options.ros2.faults import Fault, check_age, nothing_on
from options.ros2.link import Link, node_name
from options.ros2.samples import stamp_of
from options.ros2.topic_buffer import Arrived, TopicBuffer
from options.ros2.whereabouts import find_whereabouts
from perception.detector import configuration
from perception.types import Boxes
from swarm.errors import SilentError, WorldError
from swarm.geometry import Pose, pose_of
from swarm.log import Logger
from worlds.base import GroundTruth, Scan

FOREVER = 2**62
_CLOUDS, _POSES = 8, 4096
"""Messages kept until a frame asks for them."""
_LOSS_LOG_S = 10.0


@dataclass(frozen=True, slots=True)
class _Look:
    """A scan that was read."""

    message: Arrived
    scan: Scan


class LiveWorld:
    """A world with one robot, which a frame shows as it was at its newest scan.

    A frame's number says only when it is asked for; the scan says when it was taken. What has no
    fresh scan, or a scan without its pose, raises SilentError.
    """

    name = "ros2"
    frame_count = FOREVER

    def __init__(self, address: Address, robot: str, process: str, log: Logger) -> None:
        """Returns at once; the robot may come later. `process`: whose world this is."""
        self.robots: tuple[str, ...] = (robot,)
        self.rate_hz: float = address.rate
        self.detector: str = address.detector
        self.range_m = configuration(address.detector).sensor.range_m
        self._address = address
        self._log = log.bind(robot=robot)
        self._clouds = TopicBuffer(address.points, CLOUD, _CLOUDS)
        kind = ODOMETRY if address.odom else TRANSFORMS
        self._poses = TopicBuffer(address.odom or address.tf, kind, _POSES)
        static = TopicBuffer(address.tf_static, TRANSFORMS, _POSES)
        self._where = find_whereabouts(address, self._poses, static)
        self._world_from_fixed = address.origin.matrix()
        buffers = (self._clouds, self._poses, static)
        self._link = Link(address, buffers, node_name(process, robot), self._log)
        self._lock = threading.Lock()
        self._last: _Look | None = None
        self._failing = ""
        self._loss_told, self._loss_at = 0, float("-inf")

    def __enter__(self) -> LiveWorld:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def lost(self) -> int:
        """Scans that the robot counted and that did not come."""
        return self._clouds.lost

    def pose(self, robot: str, frame: int) -> Pose:
        """Where the newest scan was taken. Raises SilentError when there is no fresh one."""
        return self.scan(robot, frame).pose

    def scan(self, robot: str, frame: int) -> Scan:
        """The newest scan whose pose is known, and when it was taken.

        Raises SilentError when it is older than the address allows, or there is none; the text
        says what is missing. Raises WorldError for a scan that cannot be used, so long as the one
        before is fresh.
        """
        if robot not in self.robots:
            raise WorldError(f"robot {robot!r} is not {self.robots[0]!r}, whose sensor this is")
        with self._lock:
            now_ns = time.time_ns()
            self._tell_loss()
            try:
                scan = self._newest(now_ns)
            except Fault as fault:
                if fault.kind != self._failing:
                    self._log.warning("ros2_no_scan", kind=fault.kind, error=str(fault)[:300])
                self._failing = fault.kind
                if self._last is not None and self._age_ns(self._last.scan, now_ns) <= (
                    self._address.max_age_ns
                ):
                    raise
                raise SilentError(str(fault)) from fault
            if self._failing:
                self._log.info("ros2_scans")
            self._failing = ""
            return replace(scan, frame=frame)

    def ground_truth(self, frame: int) -> GroundTruth:
        """None: nobody knows what is really there."""
        return GroundTruth(Boxes.empty(), (), np.zeros(0, dtype=np.int64))

    def close(self) -> None:
        """Leaves the robot's network."""
        self._link.close()

    def _newest(self, now_ns: int) -> Scan:
        self._where.update()
        recent = self._clouds.recent()
        if not recent:
            raise self._nothing(self._clouds)
        message, stamp_ns, frame = self._with_pose(recent)
        taken_ns = self._taken_ns(message, stamp_ns)
        check_age(self._address, recent[0], message, taken_ns, now_ns)
        if self._last is None or self._last.message is not message:
            self._last = _Look(message, self._read(message, stamp_ns, frame, taken_ns))
        return self._last.scan

    def _with_pose(self, recent: list[Arrived]) -> tuple[Arrived, int, str]:
        """The newest scan that a pose follows, with its stamp and frame."""
        known_ns = None
        for message in recent:
            try:
                stamp_ns = stamp_of(read_stamp(message.payload[:STAMP_BYTES]), message)
                frame = read_frame(message.payload)
            except (CdrError, struct.error) as error:
                raise self._malformed(error) from error
            if plain(frame) in FIXED:
                raise Fault(
                    "frame",
                    f"scans on {self._clouds.topic} are in {frame!r}, a frame that stays; it must "
                    "be the sensor's own, or nobody knows from where they were taken",
                )
            known_ns = self._known_ns(frame)
            if known_ns is not None and stamp_ns <= known_ns:
                return message, stamp_ns, frame
        if known_ns is None:
            raise self._nothing(self._poses)
        raise Fault(
            "poses",
            f"poses on {self._poses.topic} end {(stamp_ns - known_ns) / 1e9:.3f} s before the "
            f"oldest of the last {len(recent)} scans on {self._clouds.topic}{self._fault()}",
        )

    def _known_ns(self, frame: str) -> int | None:
        try:
            return self._where.newest_ns(frame)
        except WorldError as error:
            raise Fault("frame", str(error)) from error

    def _taken_ns(self, message: Arrived, stamp_ns: int) -> int:
        """When a scan was taken, on this machine's clock."""
        if self._address.stamps == "arrival":
            return message.received_ns
        return stamp_ns + (self._clock_ahead_ns() if message.attachment is not None else 0)

    def _clock_ahead_ns(self) -> int:
        """How far this machine's clock is ahead of the robot's, by the message that took the least.

        That is seldom a cloud: poses are small.
        """
        clocks = (self._clouds.clock.ns, self._poses.clock.ns)
        return min((ns for ns in clocks if ns is not None), default=0)

    def _read(self, message: Arrived, stamp_ns: int, frame: str, taken_ns: int) -> Scan:
        try:
            points = read_cloud(message.payload).points
        except (CdrError, struct.error) as error:
            raise self._malformed(error) from error
        try:
            placed = self._where.at(frame, stamp_ns)
            velocity = self._where.velocity(frame, stamp_ns)
        except WorldError as error:
            raise Fault("pose", str(error)) from error
        if not placed.known:
            raise Fault(
                "poses",
                f"no pose on {self._poses.topic} is near the newest scan on {self._clouds.topic}",
            )
        x, y, z = self._world_from_fixed[:3, :3] @ np.array(velocity)
        return Scan(
            robot=self.robots[0],
            frame=0,
            points=points,
            pose=pose_of(self._world_from_fixed @ placed.a_from_b),
            velocity=(float(x), float(y), float(z)),
            captured_ns=taken_ns,
        )

    def _nothing(self, buffer: TopicBuffer) -> Fault:
        if buffer is self._poses and self._where.fault:
            return Fault("malformed", self._where.fault)
        return nothing_on(buffer, self._link, self._address)

    def _malformed(self, error: Exception) -> Fault:
        return Fault("malformed", f"a scan on {self._clouds.topic} is malformed: {error}")

    def _fault(self) -> str:
        return f"; {self._where.fault}" if self._where.fault else ""

    def _age_ns(self, scan: Scan, now_ns: int) -> int:
        return now_ns - (scan.captured_ns or 0)

    def _tell_loss(self) -> None:
        now, lost = time.monotonic(), self._clouds.lost
        if lost > self._loss_told and now - self._loss_at >= _LOSS_LOG_S:
            self._log.warning("ros2_scans_lost", topic=self._clouds.topic, lost=lost)
            self._loss_told, self._loss_at = lost, now
