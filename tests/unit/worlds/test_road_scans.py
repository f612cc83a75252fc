"""Scans of the road world: the sensor's pattern, the bodies that return points, repeatability."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from swarm.geometry import Pose, invert, transform
from tests.support.paths import REPOSITORY
from worlds.road.world import RoadWorld


def digest(world: RoadWorld) -> str:
    scan, actors = world.scan_with_actors("R2", 17)
    return hashlib.sha256(scan.points.tobytes() + actors.tobytes()).hexdigest()


def test_another_process_computes_the_same_scan() -> None:
    code = (
        "from tests.unit.worlds.test_road_scans import digest\n"
        "from worlds.road.world import RoadWorld\n"
        "print(digest(RoadWorld(seed=4)))"
    )
    root = REPOSITORY
    out = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True
    )
    assert out.stdout.strip() == digest(RoadWorld(seed=4))


def test_seeds_and_frames_differ() -> None:
    a, b = RoadWorld(seed=4), RoadWorld(seed=5)
    assert digest(a) != digest(b)
    assert not np.array_equal(a.scan("R1", 0).points[:100], a.scan("R1", 1).points[:100])


def test_a_scan_has_the_pattern_of_opv2vs_sensor() -> None:
    points = RoadWorld(seed=1).scan("R1", 0).points.astype(np.float64)
    distance = np.linalg.norm(points, axis=1)
    elevation = np.degrees(np.arcsin(points[:, 2] / distance))
    ring = (elevation + 25.0) / (27.0 / 63.0)
    assert np.abs(ring - np.round(ring)).max() < 0.01
    assert distance.max() < 120.2
    lowest = points[np.round(ring) == 0]
    # A tenth of 1016 returns is lost.
    assert 870 < len(lowest) < 960
    azimuth = np.sort(np.degrees(np.arctan2(lowest[:, 1], lowest[:, 0])))
    assert np.median(np.diff(azimuth)) == pytest.approx(360.0 / 1016.0, rel=0.01)


@pytest.mark.parametrize("seed", [1, 6, 9])
def test_points_of_a_vehicle_lie_in_its_box(seed: int) -> None:
    world = RoadWorld(seed=seed)
    truth = world.ground_truth(40)
    checked = 0
    for robot in world.robots:
        scan, actors = world.scan_with_actors(robot, 40)
        points = transform(scan.pose.matrix(), scan.points)
        for index in np.unique(actors[actors >= 0]):
            x, y, z = truth.boxes.centers[index]
            box = Pose(float(x), float(y), float(z), yaw=float(truth.boxes.headings[index]))
            inside = transform(invert(box.matrix()), points[actors == index])
            # A car on a slope leans within its upright box.
            limit = truth.boxes.sizes[index] / 2 + [0.1, 0.1, 0.2]
            assert (np.abs(inside) <= limit).all(axis=1).mean() > 0.97
            checked += len(inside)
    assert checked > 1000


def test_the_truth_counts_the_points_of_all_robots() -> None:
    world = RoadWorld(seed=2)
    visible = world.ground_truth(8).visible_points
    scans = [world.scan_with_actors(robot, 8)[1] for robot in world.robots]
    expected = np.bincount(np.concatenate([s[s >= 0] for s in scans]), minlength=len(visible))
    assert np.array_equal(visible, expected)


def test_the_carrying_car_shows_bonnet_and_boot_as_in_opv2v() -> None:
    scan, actors = RoadWorld(seed=3).scan_with_actors("R1", 20)
    own = scan.points[actors == 0]
    assert 1000 < len(own) < 1700
    assert (np.abs(own[:, 0]) > 1.0).all()
    assert (np.abs(own[:, 1]) < 1.15).all()


def test_the_ground_lies_below_the_sensor() -> None:
    points = RoadWorld(seed=1).scan("R1", 50).points
    near = points[np.hypot(points[:, 0], points[:, 1]) < 10.0]
    assert np.median(near[near[:, 2] < -1.5][:, 2]) == pytest.approx(-1.93, abs=0.2)


def test_cached_scans_are_the_same(tmp_path: Path) -> None:
    plain = RoadWorld(seed=8)
    first, again = (RoadWorld(seed=8, cache=tmp_path) for _ in range(2))
    assert digest(plain) == digest(first)
    assert digest(again) == digest(plain)
    assert len(list(tmp_path.iterdir())) == 1
