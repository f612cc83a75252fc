"""The factory's scans: repeatable, regular, and true to the actors."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from perception.types import Boxes
from swarm.errors import WorldError
from swarm.geometry import Points, Pose, invert, transform
from tests.support.paths import REPOSITORY
from worlds.factory.lidar import COLUMNS, DROP_OUT, NOISE_M, RANGE_STEP_M
from worlds.factory.world import FactoryWorld
from worlds.registry import open_world


@pytest.fixture(scope="module")
def world() -> FactoryWorld:
    return FactoryWorld()


def outside_m(points: Points, boxes: Boxes, index: int) -> float:
    """How far the worst of the points lies outside the box, metres."""
    x, y, z = boxes.centers[index]
    local = transform(invert(Pose(x, y, z, yaw=boxes.headings[index]).matrix()), points)
    return float((np.abs(local) - boxes.sizes[index] / 2).max())


def test_another_process_computes_the_same_points(world: FactoryWorld) -> None:
    code = (
        "import hashlib; from worlds.factory.world import FactoryWorld; w = FactoryWorld()\n"
        "w.scan('R2', 5); w.scan('R1', 40)\n"
        "print(hashlib.sha256(w.scan('R1', 41).points.tobytes()).hexdigest())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, check=True
    )
    here = hashlib.sha256(world.scan("R1", 41).points.tobytes()).hexdigest()
    assert done.stdout.strip() == here


def test_frames_robots_seeds_and_scenarios_differ(world: FactoryWorld) -> None:
    clouds = [
        world.scan("R1", 0),
        world.scan("R1", 1),
        world.scan("R2", 0),
        FactoryWorld(seed=2).scan("R1", 0),
        FactoryWorld(scenario="bandwidth-drop").scan("R1", 0),
    ]
    assert len({scan.points.tobytes() for scan in clouds}) == len(clouds)


def test_frames_beyond_the_last_wrap_around(world: FactoryWorld) -> None:
    first, again = world.scan("R3", 2), world.scan("R3", 2 + world.frame_count)
    assert again.frame == 2
    assert np.array_equal(first.points, again.points)
    assert first.pose == again.pose


@pytest.mark.parametrize("frame", [0, 700, 3333])
def test_the_points_of_an_actor_lie_in_its_true_box(world: FactoryWorld, frame: int) -> None:
    truth = world.ground_truth(frame)
    seen = np.zeros(len(truth.ids), dtype=int)
    for robot in world.robots:
        scan, actors = world.scan_with_actors(robot, frame)
        points = transform(scan.pose.matrix(), scan.points)
        for index in np.unique(actors[actors >= 0]):
            mine = points[actors == index]
            assert outside_m(mine, truth.boxes, index) < 5.5 * NOISE_M, truth.ids[index]
            seen[index] += len(mine)
    assert np.array_equal(seen, truth.visible_points)
    assert set(truth.boxes.labels) == {"robot", "forklift", "person"}


def test_a_robot_never_sees_itself(world: FactoryWorld) -> None:
    truth = world.ground_truth(0)
    for robot in world.robots:
        scan, actors = world.scan_with_actors(robot, 0)
        assert truth.ids.index(robot) not in actors
        assert np.hypot(scan.points[:, 0], scan.points[:, 1]).min() > 0.45


@pytest.mark.parametrize("rings", [16, 32, 64])
def test_points_come_ring_by_ring_in_ascending_azimuth(rings: int) -> None:
    scan = FactoryWorld(rings=rings).scan("R1", 7)
    points = scan.points.astype(np.float64)
    elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    ring = (elevation - np.radians(-25)) / np.radians(40) * (rings - 1)
    column = np.mod(np.arctan2(points[:, 1], points[:, 0]), 2 * np.pi) / (2 * np.pi) * COLUMNS
    assert np.abs(ring - np.round(ring)).max() < 1e-3
    assert np.abs(column - np.round(column)).max() < 1e-3
    order = np.round(ring) * COLUMNS + np.round(column) % COLUMNS
    assert (np.diff(order) > 0).all()
    assert scan.points.dtype == np.float32


def test_ranges_are_told_in_steps_along_the_rays(world: FactoryWorld) -> None:
    points = world.scan("R2", 17).points.astype(np.float64)
    steps = np.linalg.norm(points, axis=1) / RANGE_STEP_M
    assert np.abs(steps - np.rint(steps)).max() < 0.01
    towards = world.rays().directions.reshape(-1, 3).astype(np.float64)
    lowest = towards[: world.rays().directions.shape[1]]
    ways = points[:500] / np.linalg.norm(points[:500], axis=1)[:, None]
    assert (ways @ lowest.T).max(axis=1) == pytest.approx(1.0, abs=1e-6)


def test_noise_and_drop_out_are_as_stated(world: FactoryWorld) -> None:
    floor_misses, returned = [], 0
    for frame in range(0, 400, 40):
        scan = world.scan("R1", frame)
        returned += len(scan.points)
        distance = np.linalg.norm(scan.points, axis=1)
        # The lowest ring meets the floor 2.6 m away, or something in front of it.
        lowest = scan.points[:, 2] / distance < np.sin(np.radians(-24.9))
        expected = scan.pose.z / np.sin(np.radians(25))
        misses = distance[lowest] - expected
        floor_misses.append(misses[np.abs(misses) < 0.15])
    assert np.concatenate(floor_misses).std() == pytest.approx(NOISE_M, rel=0.1)
    assert 0.9 * 32 * COLUMNS < returned / 10 < (1 - DROP_OUT / 2) * 32 * COLUMNS


def test_ranges_stay_within_the_reach(world: FactoryWorld) -> None:
    distance = np.linalg.norm(world.scan("R4", 9).points, axis=1)
    assert distance.min() >= 0.3
    assert distance.max() <= world.range_m + 1e-4


@pytest.mark.parametrize("robots", [3, 100])
def test_small_and_large_swarms_scan(robots: int) -> None:
    world = FactoryWorld(robots=robots)
    assert world.robots[-1] == f"R{robots}"
    assert len(world.scan(world.robots[-1], 12).points) > 10_000
    poses = np.array([world.pose(robot, 12).as_tuple()[:2] for robot in world.robots])
    apart = np.linalg.norm(poses[:, None] - poses[None], axis=2)
    assert apart[~np.eye(robots, dtype=bool)].min() > 1.0


def test_the_scans_of_one_frame_are_computed_once_in_the_largest_swarm() -> None:
    world = FactoryWorld(robots=100, rings=16)
    world.scan("R1", 4)
    world.ground_truth(5)
    first = [world.scan(robot, 5).points for robot in world.robots]
    again = [world.scan(robot, 5).points for robot in world.robots]
    assert all(a is b for a, b in zip(first, again, strict=True))


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ({"robots": 1}, r"1 robots.*2 to 1000"),
        ({"robots": 1001}, r"1001 robots.*2 to 1000"),
        ({"rings": 48}, r"48 rings.*16, 32, 64"),
        ({"scenario": "moon"}, r"'moon'.*floor, redundant-cluster"),
        ({"seed": -1}, r"seed -1"),
    ],
)
def test_values_that_are_not_allowed_are_named(setting: dict[str, Any], named: str) -> None:
    with pytest.raises(WorldError, match=named):
        FactoryWorld(**setting)


def test_an_unknown_robot_is_named(world: FactoryWorld) -> None:
    with pytest.raises(WorldError, match=r"'R7'.*R1 to R6"):
        world.scan("R7", 0)


def test_the_registry_opens_a_factory() -> None:
    assert open_world("factory", robots=3, rings=16).robots == ("R1", "R2", "R3")
