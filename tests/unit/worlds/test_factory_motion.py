"""How things move in the factory: smoothly, without end, and around each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.boxes import iou_bev
from perception.types import Boxes
from worlds.factory.paths import Laps, Loop
from worlds.factory.scenarios import SCENARIOS
from worlds.factory.world import FactoryWorld

TOP_SPEED = {"robot": 1.5, "forklift": 2.1, "person": 1.3}


@given(
    offset=st.floats(0.5, 4.0),
    laps=st.integers(1, 20),
    phase=st.floats(-2.0, 2.0),
    sway=st.floats(0.0, 0.9),
    slow_at=st.floats(0.0, 1.0),
    time_s=st.floats(0.0, 700.0),
)
def test_laps_are_smooth_and_repeat_after_the_period(
    offset: float, laps: int, phase: float, sway: float, slow_at: float, time_s: float
) -> None:
    path = Laps(Loop(10.0, 20.0, 6.2, offset), laps, 600.0, phase, sway, slow_at)
    here, later, again = (path.at(t) for t in (time_s, time_s + 0.01, time_s + 600.0))
    assert math.hypot(again.x - here.x, again.y - here.y) < 1e-6
    moved = (later.x - here.x, later.y - here.y)
    expected = [0.01 * v for v in here.velocity[:2]]
    turned_m = (later.speed * 0.01) ** 2 / offset
    assert moved == pytest.approx(expected, abs=turned_m + 1e-2 * abs(here.speed - later.speed))


@given(way=st.floats(-500.0, 500.0), offset=st.floats(0.5, 4.0))
def test_a_loop_keeps_its_distance_from_the_block(way: float, offset: float) -> None:
    x, y, _ = Loop(0.0, 0.0, 6.2, offset).point(way)
    assert math.hypot(max(abs(x) - 6.2, 0), max(abs(y) - 6.2, 0)) == pytest.approx(offset)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_everything_moves_smoothly_also_from_the_last_frame_to_the_first(scenario: str) -> None:
    world = FactoryWorld(scenario=scenario)
    end = world.frame_count
    for frames in (range(0, 600), range(end - 3, end + 3)):
        places = np.array([[world.pose(r, f).as_tuple()[:2] for r in world.robots] for f in frames])
        steps = np.linalg.norm(np.diff(places, axis=0), axis=2) * world.rate_hz
        assert steps.max() < TOP_SPEED["robot"]


def actors(world: FactoryWorld, frame: int) -> Boxes:
    return world.ground_truth(frame).boxes


def static(world: FactoryWorld) -> Boxes:
    low, high = world.floor.boxes[:, :3], world.floor.boxes[:, 3:]
    reached = low[:, 2] < 2.1
    low, high = low[reached], high[reached]
    count = len(low)
    return Boxes((low + high) / 2, high - low, np.zeros(count), np.ones(count), ("static",) * count)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_nothing_drives_through_anything(scenario: str) -> None:
    world = FactoryWorld(robots=6, rings=16, scenario=scenario)
    equipment = static(world)
    for frame in range(0, world.frame_count, 500):
        boxes = actors(world, frame)
        overlap = iou_bev(boxes, boxes)
        assert overlap[~np.eye(len(boxes), dtype=bool)].max() == 0.0, frame
        assert iou_bev(boxes, equipment).max() == 0.0, frame


def test_the_velocity_is_that_of_the_poses() -> None:
    world = FactoryWorld(rings=16)
    for robot in world.robots:
        before, after = world.pose(robot, 99), world.pose(robot, 101)
        moved = (after.x - before.x, after.y - before.y)
        velocity = world.scan(robot, 100).velocity
        assert [v * 0.2 for v in velocity[:2]] == pytest.approx(moved, abs=0.02)
        assert velocity[2] == 0.0


def test_the_floor_grows_with_the_swarm() -> None:
    areas = [
        world.floor.width_m * world.floor.depth_m
        for world in (FactoryWorld(robots=n) for n in (6, 12, 50, 100))
    ]
    assert areas[0] == pytest.approx(2500)
    assert areas == sorted(areas)
    assert areas[-1] > 30_000
