"""Plans of the road world: what differs between seeds, what never touches, what moves smoothly."""

from __future__ import annotations

import numpy as np
import pytest

from perception.boxes import iou_bev
from swarm.errors import WorldError
from worlds.registry import open_world
from worlds.road.world import RoadWorld

SEEDS = range(1, 8)


def boxes(world: RoadWorld, frame: int) -> tuple[np.ndarray, ...]:
    truth, _ = world.actors(frame)
    return truth.centers, truth.sizes, truth.headings


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_vehicles_never_overlap(seed: int) -> None:
    world = RoadWorld(seed=seed)
    for frame in range(0, 100, 9):
        truth, _ = world.actors(frame)
        overlap = iou_bev(truth, truth) - np.eye(len(truth))
        assert np.abs(overlap).max() < 1e-6


def test_each_seed_is_another_street() -> None:
    counts = {len(RoadWorld(seed=seed).actors(0)[1]) for seed in SEEDS}
    headings = [RoadWorld(seed=seed).pose("R1", 0).heading for seed in SEEDS]
    assert len(counts) > 3
    assert np.ptp(headings) > 3.0


def test_sizes_are_those_of_cars_and_light_trucks() -> None:
    for seed in SEEDS:
        _, sizes, _ = boxes(RoadWorld(seed=seed), 50)
        assert (sizes >= [3.5, 1.7, 1.2]).all()
        assert (sizes <= [6.8, 2.5, 2.9]).all()


def test_robots_drive_recording_cars_within_sight_of_the_first() -> None:
    for seed in SEEDS:
        world = RoadWorld(robots=3, seed=seed)
        truth, names = world.actors(50)
        assert names[:3] == ("R1", "R2", "R3")
        assert np.allclose(truth.sizes[:3], (4.9, 2.13, 1.51))
        away = [world.pose("R1", 50).distance_to(world.pose(r, 50)) for r in ("R2", "R3")]
        assert min(away) > 3.0
        assert max(away) < 90.0


def test_motion_is_smooth() -> None:
    world = RoadWorld(seed=5)
    centers = np.array([boxes(world, frame)[0] for frame in range(40, 60)])
    speed = np.linalg.norm(np.diff(centers, axis=0), axis=2) * world.rate_hz
    assert speed.max() < 20.0
    assert np.abs(np.diff(speed, axis=0)).max() < 1.0
    assert speed.max() > 0.5


def test_the_velocity_is_the_change_of_the_pose() -> None:
    world = RoadWorld(seed=3)
    a, b = world.pose("R1", 10), world.pose("R1", 11)
    expected = ((b.x - a.x) * 10, (b.y - a.y) * 10, (b.z - a.z) * 10)
    assert np.allclose(world.scan("R1", 10).velocity, expected)


def test_frames_wrap_around() -> None:
    world = RoadWorld(seed=3)
    assert world.pose("R2", world.frame_count + 7) == world.pose("R2", 7)


def test_the_registry_opens_it() -> None:
    world = open_world("road", robots=3, seed=2)
    assert (world.name, world.detector, world.robots) == ("road", "road", ("R1", "R2", "R3"))


def test_values_that_are_not_allowed() -> None:
    with pytest.raises(WorldError, match="51 robots"):
        RoadWorld(robots=51)
    with pytest.raises(WorldError, match="seed -1"):
        RoadWorld(seed=-1)
    with pytest.raises(WorldError, match="R9"):
        RoadWorld().scan("R9", 0)
