"""A recording of a swarm as a world: scans, poses and ground truth as they were."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise
from math import gcd
from pathlib import Path

import numpy as np

from options.recordings.file import RecordingFile
from options.recordings.format import TRUTH, Frame, RobotInFrame, Truth
from perception.types import Boxes
from swarm.errors import WorldError
from swarm.geometry import Points, Pose
from worlds.base import GroundTruth, Rays, Scan, SelfDescribing
from worlds.recent import Recent

MAX_KEPT = 64
"""Scans and frames in memory; a scan of 32 rings takes 400 kB."""
HELD_S = 1.0
"""Seconds for which a frame stands in for those after it that were not recorded."""


class RecordingWorld(SelfDescribing):
    """A file of `coadapt record`. No scan is read before it is asked for.

    Frame 0 is the first recorded one. Frames are as far apart as the recorded ones; one that the
    ego left out shows the frame before it, for HELD_S. In later ones, as while the ego was down,
    nobody sees anything; nor does a robot in a frame in which its scan was not recorded
    (`--points selected`).
    """

    name = "recording"

    def __init__(self, path: Path) -> None:
        """Opens a recording. Raises WorldError that names what is missing."""
        self.file = RecordingFile(path)
        header = self.file.header
        self.notes = self.file.notes + _notes(self.file)
        """What is wrong with a recording that can be used all the same."""
        self._times = self.file.frames()
        if header.rate_hz is None or header.range_m is None or header.detector is None:
            raise WorldError(f"recording {path} does not say its rate_hz, range_m and detector")
        self.robots = header.robots
        self.ego = header.ego if header.ego in header.robots else header.robots[0]
        self.range_m: float = header.range_m
        self.detector: str = header.detector
        self.comm_range_m = header.comm_range_m
        """How far from the ego a robot could take part; None: as the ego's settings say."""
        self._numbers = [
            round((time_ns - header.epoch_ns) * header.rate_hz / 1e9) for time_ns in self._times
        ]
        self._stride = gcd(*(after - before for before, after in pairwise(self._numbers))) or 1
        self._held = int(HELD_S * header.rate_hz)
        self.rate_hz: float = header.rate_hz / self._stride
        self.frame_count = 1 + (self._numbers[-1] - self._numbers[0]) // self._stride
        self._recent = Recent(MAX_KEPT)

    def frame_of(self, number: int) -> int | None:
        """This world's frame for the recorded swarm's number; None when it was not recorded."""
        at = bisect_right(self._numbers, number) - 1
        if at < 0 or self._numbers[at] != number:
            return None
        return (number - self._numbers[0]) // self._stride

    def recorded_frames(self) -> tuple[int, ...]:
        """This world's frames that were recorded: no other stands in for them."""
        return tuple((number - self._numbers[0]) // self._stride for number in self._numbers)

    def judged_frames(self) -> tuple[int, ...]:
        """Those of the recorded frames that come with what was really there."""
        return tuple(
            frame
            for frame, time_ns in zip(self.recorded_frames(), self._times, strict=True)
            if self.file.has(TRUTH, time_ns)
        )

    def rays(self) -> Rays | None:
        """See `worlds.base.Rayed`: those of the recorded world."""
        return self.file.rays

    def pose(self, robot: str, frame: int) -> Pose:
        """See `worlds.base.World`."""
        return Pose(*self._robot(robot, frame).pose)

    def scan(self, robot: str, frame: int) -> Scan:
        """See `worlds.base.World`."""
        found, (time_ns, fresh) = self._robot(robot, frame), self._shown(frame)
        there = fresh and found.points is not None
        return Scan(
            robot=robot,
            frame=frame % self.frame_count,
            points=self._points(robot, time_ns) if there else np.zeros((0, 3), dtype=np.float32),
            pose=Pose(*found.pose),
            velocity=found.velocity,
        )

    def ground_truth(self, frame: int) -> GroundTruth:
        """As the recorded world had it; no boxes where it had none."""
        time_ns, fresh = self._shown(frame)
        if not fresh or not self.file.has(TRUTH, time_ns):
            return GroundTruth(Boxes.empty(), (), np.zeros(0, dtype=np.int64))
        boxes = self.file.message(TRUTH, time_ns, Truth).boxes
        return GroundTruth(
            boxes=Boxes(
                centers=np.array([box.center for box in boxes], dtype=np.float64).reshape(-1, 3),
                sizes=np.array([box.size for box in boxes], dtype=np.float64).reshape(-1, 3),
                headings=np.array([box.heading for box in boxes], dtype=np.float64),
                scores=np.ones(len(boxes)),
                labels=tuple(box.label for box in boxes),
            ),
            ids=tuple(box.id for box in boxes),
            visible_points=np.array([box.visible_points for box in boxes], dtype=np.int64),
        )

    def _points(self, robot: str, time_ns: int) -> Points:
        points: Points = self._recent.get(
            (robot, time_ns), lambda: self.file.points(robot, time_ns)
        )
        return points

    def _robot(self, robot: str, frame: int) -> RobotInFrame:
        time_ns, _ = self._shown(frame)
        shown: Frame = self._recent.get(time_ns, lambda: self.file.frame(time_ns))
        if robot not in self.robots or robot not in shown.robots:
            raise WorldError(
                f"robot {robot!r} is not in recording {self.file.path}; it has "
                f"{', '.join(self.robots)}"
            )
        return shown.robots[robot]

    def _shown(self, frame: int) -> tuple[int, bool]:
        """The capture time of the newest recorded frame at or before one, and whether it is near
        enough to stand in for it."""
        number = self._numbers[0] + frame % self.frame_count * self._stride
        at = bisect_right(self._numbers, number) - 1
        return self._times[at], number - self._numbers[at] <= self._held


def _notes(file: RecordingFile) -> tuple[str, ...]:
    if file.header.points != "selected":
        return ()
    return (
        f"{file.path} was recorded with --points selected: robots that were not asked have no scan",
    )
