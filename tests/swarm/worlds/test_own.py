"""Worlds of one's own in real processes that are started by hand: the ego fuses them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.ego_swarm import swarm_of
from tests.support.world_bags import ROAD_SEED
from tests.support.yard_world import add_yard
from worlds.road.world import RoadWorld


def test_a_world_by_one_file_is_fused(tmp_path: Path) -> None:
    environment = add_yard(tmp_path / "code")
    with swarm_of(environment | {"COADAPT_WORLD": "yard"}, tmp_path) as swarm:
        swarm.router()
        frames = swarm.detections(swarm.session(), "north")
        swarm.robot("south")
        swarm.ego(ego="north", period_s="0.25")
        frames.until(lambda one: one.bytes.get("south", 0) > 0 and len(one.labels) > 0)


@pytest.mark.stumble(
    "a folder of .bin scans is not fused by a swarm", command="make up WORLD=scans DATA=dir"
)
def test_a_folder_of_bin_scans_is_fused(tmp_path: Path) -> None:
    cars = RoadWorld(robots=2, seed=ROAD_SEED)
    for robot in cars.robots:
        folder = tmp_path / "lot" / robot
        folder.mkdir(parents=True)
        scans = [cars.scan(robot, frame) for frame in range(10)]
        for frame, scan in enumerate(scans):
            four = np.column_stack([scan.points, np.zeros(len(scan.points))]).astype("<f4")
            four.tofile(folder / f"{frame:06d}.bin")
        np.savetxt(folder / "poses.txt", [scan.pose.matrix()[:3].ravel() for scan in scans])
    world = {"COADAPT_WORLD": "scans", "COADAPT_WORLD_DATA": str(tmp_path / "lot")}
    with swarm_of(world, tmp_path) as swarm:
        swarm.router()
        frames = swarm.detections(swarm.session(), "R1")
        swarm.robot("R2")
        swarm.ego(ego="R1", period_s="0.25")
        frames.until(lambda one: one.bytes.get("R2", 0) > 0 and len(one.labels) > 0)
