"""A world by one file, as CONTRIBUTING promises it: copied into a copy of `worlds/`."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from tests.support.paths import REPOSITORY

YARD = """
from __future__ import annotations

import numpy as np

from perception.types import Boxes
from swarm.errors import WorldError
from swarm.geometry import Pose
from worlds.base import GroundTruth, Scan
from worlds.kinds import WorldKind

AT = {"north": Pose(0.0, 4.0, 1.2), "south": Pose(0.0, -4.0, 1.2)}


class Yard:
    name = "yard"
    robots = tuple(AT)
    rate_hz = 10.0
    frame_count = 100
    range_m = 40.0
    detector = "factory"

    def pose(self, robot, frame):
        if robot not in AT:
            raise WorldError(f"robot {robot!r} is not in the yard: {', '.join(AT)}")
        return AT[robot]

    def scan(self, robot, frame):
        floor = np.stack(np.meshgrid(np.arange(-9, 9, 0.2), np.arange(-9, 9, 0.2)), -1)
        floor = np.column_stack([floor.reshape(-1, 2), np.full(8100, -1.2)])
        side = np.stack(np.meshgrid(np.arange(-0.2, 0.2, 0.05), np.arange(-1.1, 0.6, 0.05)), -1)
        side = side.reshape(-1, 2)
        worker = np.column_stack([np.full(len(side), 5.0), side])
        points = np.concatenate([floor, worker]).astype(np.float32)
        return Scan(robot, frame, points, self.pose(robot, frame), (0.0, 0.0, 0.0))

    def ground_truth(self, frame):
        return GroundTruth(Boxes.empty(), (), np.zeros(0, dtype=np.int64))


WORLDS = (WorldKind("yard", lambda request: Yard()),)
"""


def add_yard(folder: Path) -> dict[str, str]:
    """Puts the world `yard` into a copy of the package, in a folder; returns the environment in
    which new processes find it."""
    shutil.copytree(REPOSITORY / "worlds", folder / "worlds")
    (folder / "worlds" / "yard.py").write_text(YARD)
    return {
        **os.environ,
        "PYTHONPATH": f"{folder}{os.pathsep}{REPOSITORY}",
        # Else the current directory comes first.
        "PYTHONSAFEPATH": "1",
    }
