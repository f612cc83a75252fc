"""What one robot recorded: its scans, by when they were taken, and where it was."""

from __future__ import annotations

import numpy as np

from options.bags.motion import find_motion
from options.bags.recording import Recording
from options.bags.settings import RobotSettings
from options.bags.stamps import read_stamps
from options.ros.frames import FIXED, Velocity, plain
from options.ros.messages import CLOUD, Cloud, read_cloud, read_frame
from options.ros.track import Placed
from swarm.errors import WorldError
from swarm.geometry import Matrix
from worlds.timing import timing
from worlds.world_file import FILE_NAME


class RobotLog:
    """One robot's bag; scans are numbered by when they were taken. Times are nanoseconds of its own
    stamps, less how far its clock is said to be ahead."""

    def __init__(self, robot: str, recording: Recording, settings: RobotSettings) -> None:
        """Finds its topics and how far they reach. Raises WorldError when one is missing."""
        self.robot = robot
        self.topic = _points_topic(recording, settings)
        self._clouds = recording.messages(self.topic)
        stamps = read_stamps(self._clouds)
        self.ahead_ns = round((settings.clock_offset_s or 0.0) * 1e9)
        """How far the robot's clock is ahead of the world's time."""
        stamps = stamps - self.ahead_ns
        self._order = np.argsort(stamps, kind="stable")
        self._stamps = stamps[self._order]
        """int64 (N,): when each scan was taken, in order, by the world's time."""
        frame = self._clouds.decode(0, read_frame)
        if plain(frame) in FIXED:
            raise WorldError(
                f"scans of bag {recording.path} (topic {self.topic}) are in {frame!r}, a frame "
                "that stays; they must be in the sensor's own, or nobody knows from where they "
                "were taken"
            )
        self._motion = find_motion(recording, frame, settings)
        self.timing = timing(
            robot,
            stamps,
            self._clouds.times_ns,
            trusted=settings.clock_offset_s is not None,
            poses_lags_s=self._motion.lags_s + self.ahead_ns / 1e9,
        )
        self._world_from_fixed: Matrix = settings.origin.pose().matrix()
        scans = int(self._stamps[0]), int(self._stamps[-1])
        begin, end = (
            scans
            if self._motion.span_ns is None
            else (stamp - self.ahead_ns for stamp in self._motion.span_ns)
        )
        self.first_ns, self.last_ns = max(scans[0], begin), min(scans[1], end)
        if self.first_ns > self.last_ns:
            raise WorldError(
                f"scans and poses of bag {recording.path} share no time: scans (topic "
                f"{self.topic}) are stamped {seconds(*scans)}, poses {seconds(begin, end)}"
            )

    @property
    def scans(self) -> int:
        """How many there are."""
        return len(self._stamps)

    def stamp(self, index: int) -> int:
        """When a scan was taken: its header's stamp, or else when it was recorded."""
        return int(self._stamps[index])

    def newest(self, time_ns: int) -> int | None:
        """The index of the newest scan at or before a time; None before the first."""
        after = int(np.searchsorted(self._stamps, time_ns, side="right"))
        return after - 1 if after else None

    def cloud(self, index: int) -> Cloud:
        """A scan, read from the bag."""
        return self._clouds.decode(int(self._order[index]), read_cloud)

    def placed(self, time_ns: int) -> Placed:
        """`world_from_sensor`."""
        placed = self._motion.at(time_ns + self.ahead_ns)
        return Placed(self._world_from_fixed @ placed.a_from_b, placed.known)

    def velocity(self, time_ns: int) -> Velocity:
        """Of the sensor in the world frame, m/s."""
        x, y, z = self._world_from_fixed[:3, :3] @ np.array(
            self._motion.velocity(time_ns + self.ahead_ns)
        )
        return (float(x), float(y), float(z))


def seconds(begin_ns: int, end_ns: int) -> str:
    """An interval as a message says it."""
    return f"{begin_ns / 1e9:.3f} to {end_ns / 1e9:.3f} s"


def _points_topic(recording: Recording, settings: RobotSettings) -> str:
    there = recording.topics_of(CLOUD)
    if settings.points:
        kind = recording.topics.get(settings.points)
        if kind != CLOUD:
            raise WorldError(
                f"topic {settings.points!r} of bag {recording.path} is {kind or 'not there'}; "
                f"{FILE_NAME} needs it to be {CLOUD}; there "
                f"{'are ' + ', '.join(there) if there else 'is none'}"
            )
        return settings.points
    if len(there) > 1:
        raise WorldError(
            f"bag {recording.path} has several {CLOUD} topics: {', '.join(there)}; name one in "
            f"{FILE_NAME} (points = ...)"
        )
    if not there:
        others = ", ".join(f"{name} ({kind})" for name, kind in sorted(recording.topics.items()))
        raise WorldError(
            f"bag {recording.path} has no {CLOUD} topic with messages in CDR; it has "
            f"{others or 'no messages at all'}{''.join('; ' + note for note in recording.notes)}"
        )
    return there[0]
