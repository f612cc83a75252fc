"""The detector's `factory` configuration fits the factory's actors."""

from __future__ import annotations

import numpy as np
import pytest

from perception.boxes import iou_bev
from perception.detector import configuration, detect
from perception.metrics import average_precision
from perception.types import Boxes
from swarm.geometry import invert, transform
from worlds.factory.world import FactoryWorld

FRAMES = range(0, 6000, 600)


@pytest.fixture(scope="module")
def frames() -> list[tuple[Boxes, Boxes]]:
    """Boxes detected on the scans of all six robots merged, and true ones with 10 points or more
    (but R1, in whose frame they are detected)."""
    world, config = FactoryWorld(), configuration("factory")
    pairs = []
    for frame in FRAMES:
        world_from_ego = world.pose("R1", frame).matrix()
        clouds, origins = [], []
        for robot in world.robots:
            scan = world.scan(robot, frame)
            ego_from_robot = invert(world_from_ego) @ scan.pose.matrix()
            clouds.append(transform(ego_from_robot, scan.points))
            origins.append(ego_from_robot[:3, 3])
        found = detect(np.concatenate(clouds), config, np.array(origins))
        truth = world.ground_truth(frame)
        wanted = (truth.visible_points >= 10) & (np.array(truth.ids) != "R1")
        pairs.append((found.transformed(world_from_ego), truth.boxes.take(wanted)))
    return pairs


@pytest.mark.parametrize("label", ["forklift", "person"])
def test_most_forklifts_and_workers_are_found_by_their_name(
    frames: list[tuple[Boxes, Boxes]], label: str
) -> None:
    best = []
    for found, truth in frames:
        named, wanted = (
            boxes.take(np.array([name == label for name in boxes.labels], dtype=np.bool_))
            for boxes in (found, truth)
        )
        best += list(iou_bev(wanted, named).max(axis=1, initial=0.0))
    assert np.mean(np.array(best) >= 0.5) > 0.8


def test_machines_and_goods_seldom_pass_as_actors(frames: list[tuple[Boxes, Boxes]]) -> None:
    assert average_precision(frames, 0.5) > 0.6
    assert sum(len(found) for found, _ in frames) < 1.5 * sum(len(truth) for _, truth in frames)
