from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from perception.scene import describe, visible_range
from research.benchmarks.scene_recall import match, targets
from worlds.opv2v.world import Opv2vWorld


@pytest.fixture(scope="module")
def world(opv2v_dir: Path) -> Opv2vWorld:
    return Opv2vWorld(opv2v_dir)


def test_fast_describes_95_percent_of_the_vehicles_within_50_m(world: Opv2vWorld) -> None:
    found = []
    for robot in world.robots:
        for frame in range(world.frame_count):
            scan = world.scan(robot, frame)
            found += match(scan.points, "fast", targets(world, scan))
    assert len(found) > 300
    assert np.mean([each.described for each in found]) >= 0.95


def test_reference_loses_vehicles_that_fast_describes(world: Opv2vWorld) -> None:
    scan = world.scan(world.robots[0], 0)
    wanted = list(targets(world, scan))
    fast, reference = (
        sum(each.described for each in match(scan.points, method, wanted))
        for method in ("fast", "reference")
    )
    assert reference < fast


def test_a_real_scan_is_mostly_ground_and_a_bounded_number_of_objects(world: Opv2vWorld) -> None:
    points = world.scan(world.robots[0], 0).points
    scene = describe(points)
    assert len(points) / 4 < scene.ground_points < len(points)
    assert 10 < len(scene.objects) < 500
    seen = visible_range(points)
    assert (seen > 0).all()
    assert (seen <= 170).all()
