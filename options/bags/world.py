"""Robots' own logs as one world: aligned in time, placed in one frame."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from options.bags.clocks import common_span, words
from options.bags.log import RobotLog
from options.bags.recording import Recording, find_bags
from options.bags.settings import read_settings
from perception.detector import configuration
from perception.types import Boxes
from swarm.errors import WorldError
from swarm.geometry import Points, Pose, pose_of
from worlds.base import GroundTruth, Scan, SelfDescribing
from worlds.detector_choice import LOOKED_AT, choose_detector
from worlds.recent import Recent

MAX_KEPT = 32
"""Scans in memory; one of 100 000 points takes 1.2 MB."""


class BagWorld(SelfDescribing):
    """A folder of bags, one a robot. No scan is read before it is asked for.

    Frame k is the moment `start_ns + k / rate_hz` of the time that all bags cover; it shows of
    each robot the newest scan stamped at or before it, where the robot was when it took it.
    """

    name = "bag"

    def __init__(self, data: Path) -> None:
        """Opens all bags of a folder. Raises WorldError that names what is wrong with which."""
        data = Path(data)
        bags = find_bags(data)
        self.robots = tuple(bags)
        settings = read_settings(data, self.robots)
        self.comm_range_m = settings.comm_range_m
        self._max_age_ns = round(settings.max_scan_age_s * 1e9)
        recordings = {robot: Recording(path) for robot, path in bags.items()}
        self._logs = {
            robot: RobotLog(robot, recording, settings.robot(robot, data))
            for robot, recording in recordings.items()
        }
        self.timings = tuple(log.timing for log in self._logs.values())
        self.start_ns, end_ns = common_span(data, list(self._logs.values()))
        self.detector: str
        self.detector, self.choices = self._chosen_detector(settings.detector)
        self.range_m = configuration(self.detector).sensor.range_m
        self.notes = (
            *(note for one in recordings.values() for note in one.notes),
            *words(self.timings),
        )
        """What is odd about bags that can be used all the same."""
        rates = [one.rate_hz for one in self.timings if one.rate_hz]
        # To a hundredth: recorders' clocks are not better.
        measured = max(0.01, round(float(np.median(rates)), 2)) if rates else 1.0
        self.rate_hz: float = settings.rate_hz or measured
        self.frame_count = 1 + int((end_ns - self.start_ns) * self.rate_hz / 1e9 + 1e-6)
        self._recent = Recent(MAX_KEPT)

    def time_ns(self, frame: int) -> int:
        """The moment of a frame, in the bags' own stamps."""
        return self.start_ns + round(frame % self.frame_count * 1e9 / self.rate_hz)

    def pose(self, robot: str, frame: int) -> Pose:
        """Where the frame's scan was taken; without one, where the sensor was at the frame."""
        return pose_of(self._log(robot).placed(self._shown(robot, frame)[1]).a_from_b)

    def scan(self, robot: str, frame: int) -> Scan:
        """The scan of a frame: empty when it is too old, or no pose is known near its time."""
        log = self._log(robot)
        index, taken_ns = self._shown(robot, frame)
        placed = log.placed(taken_ns)
        points: Points = np.zeros((0, 3), dtype=np.float32)
        if index is not None and placed.known:
            points = self._recent.get((robot, index), lambda: log.cloud(index).points)
        return Scan(
            robot=robot,
            frame=frame % self.frame_count,
            points=points,
            pose=pose_of(placed.a_from_b),
            velocity=log.velocity(taken_ns),
        )

    def ground_truth(self, frame: int) -> GroundTruth:
        """None: nobody knows what was really there."""
        return GroundTruth(Boxes.empty(), (), np.zeros(0, dtype=np.int64))

    def _chosen_detector(self, named: str | None) -> tuple[str, tuple[str, ...]]:
        """The detector that settings name, else the one that suits the first scans best, and
        why."""
        if named is not None:
            return named, ()
        scans = []
        for log in self._logs.values():
            begin = log.newest(self.start_ns) or 0
            for index in range(begin, min(begin + LOOKED_AT, log.scans)):
                with suppress(WorldError):  # told when a frame shows it
                    scans.append(log.cloud(index).points)
        return choose_detector(scans)

    def _shown(self, robot: str, frame: int) -> tuple[int | None, int]:
        """Which scan a frame shows of a robot, and when it was taken; else the frame's moment."""
        log, now_ns = self._log(robot), self.time_ns(frame)
        index = log.newest(now_ns)
        if index is None or now_ns - log.stamp(index) > self._max_age_ns:
            return None, now_ns
        return index, log.stamp(index)

    def _log(self, robot: str) -> RobotLog:
        if robot not in self._logs:
            raise WorldError(f"robot {robot!r} has no bag; there are {', '.join(self.robots)}")
        return self._logs[robot]
