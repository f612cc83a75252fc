"""What robots have to send, uncoded, and what that takes as CoAdapt's published results count it.

Its code (houssamhh/coadapt, coadapt/run_pipeline.py) codes and sends nothing. It counts, of each
participant but the ego, a frame: of `early`, all points of the recorded cloud as x, y, z and
intensity in float32; of `intermediate`, the tensor that is handed to the fusion, in float32; of
`late`, seven float32 for each vehicle that the recording lists for it, detected or not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from perception.detector.grid import bev_config
from perception.detector.network import FEATURES
from research.evaluation.windows.choice import ALONE, Choice
from research.evaluation.windows.measure import Window

FLOAT_BYTES = 4
POINT_BYTES, BOX_BYTES = 4 * FLOAT_BYTES, 7 * FLOAT_BYTES


@dataclass(frozen=True, slots=True)
class Uncoded:
    """What one robot has to send, means over the sampled frames of a window."""

    points: float
    objects: float
    """True objects within its sensor's range, without itself."""


@dataclass(frozen=True, slots=True)
class Contents:
    """What robots have to send in all windows of a comparison."""

    detector: str
    """Whose feature maps they would send."""
    robots: Mapping[tuple[str, int], Mapping[str, Uncoded]]
    """By scenario and window, each robot's."""

    def bytes_as_published(self, scenario: str, window: int, choice: Choice) -> float:
        """Bytes a frame of a choice by the accounting of the published results."""
        return bytes_as_published(choice, self.robots[scenario, window], self.detector)


def contents(window: Window) -> dict[str, Uncoded]:
    """What every robot of a window but the ego has to send."""
    world, frames = window.world, window.scenario.sampled_frames(window.index)
    found = {}
    for robot in world.robots:
        if robot == window.ego:
            continue
        points, objects = [], []
        for frame in frames:
            truth, pose = world.ground_truth(frame), world.pose(robot, frame)
            away = truth.boxes.centers[:, :2] - [pose.x, pose.y]
            others = np.array([name != robot for name in truth.ids], dtype=np.bool_)
            objects.append(int((others & (np.hypot(*away.T) <= world.range_m)).sum()))
            points.append(len(world.scan(robot, frame).points))
        found[robot] = Uncoded(float(np.mean(points)), float(np.mean(objects)))
    return found


def bytes_as_published(choice: Choice, held: Mapping[str, Uncoded], detector: str) -> float:
    """Bytes a frame of a choice by that accounting; `detector`: whose feature maps they are."""
    senders = [held[robot] for robot in choice.participants]
    paradigm = choice.algorithm.partition("-")[0]
    if choice.algorithm == ALONE:
        return 0.0
    if paradigm == "early":
        return POINT_BYTES * sum(one.points for one in senders)
    if paradigm == "late":
        return BOX_BYTES * sum(one.objects for one in senders)
    rows, columns = bev_config(detector).cells
    return float(FLOAT_BYTES * FEATURES * rows * columns * len(senders))
