"""What is remembered of walls: where they stand, and that an object hardly stands in one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from perception.detector.config import configuration
from perception.memory import structure
from perception.memory.memory import Frame, Memory
from perception.memory.structure import FORGOTTEN_S, LESS_LIKELY, Structure
from perception.scene.structure import above_objects
from perception.types import Boxes
from swarm.geometry import Points, Pose
from worlds.registry import open_world

TALLEST_M = configuration("factory").tallest_m
HERE = Pose(3.0, -2.0, 1.2, yaw=0.5).matrix()
STRAIGHT = Pose(0.0, 0.0, 1.2).matrix()
WALL_M, THICK_M = 8.0, 0.3


def scan(height_m: float = 4.0, away_m: float = WALL_M) -> Points:
    """What a sensor 1.2 m above the floor sees of the floor, and of a block of that height across
    its way, 20 m wide and 0.3 m thick, which it can look over: its front and its top's edge."""
    x, y = np.meshgrid(np.arange(-12, away_m, 0.25), np.arange(-12, 12, 0.25))
    floor = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -1.2)])
    y, z = np.meshgrid(np.arange(-10, 10, 0.1), np.arange(-1.2, height_m - 1.2, 0.1))
    faces = [
        np.column_stack([np.full(y.size, away_m + deep), y.ravel(), z.ravel()])
        for deep in (0.0, 0.1, 0.2, THICK_M)
    ]
    return np.concatenate([floor, *faces]).astype(np.float32)


def body(
    x: float, y: float = 0.0, score: float = 0.5, sizes: tuple[float, float] = (0.5, 0.5)
) -> Boxes:
    return Boxes(
        np.array([[x, y, 0.9]]),
        np.array([[*sizes, 1.75]]),
        np.zeros(1),
        np.array([score]),
        ("person",),
    )


def learnt(points: Points) -> Structure:
    """By what is seen at -1 s and at 0 s."""
    found = Structure(TALLEST_M)
    for time_s in (-1.0, 0.0):
        found.learn(time_s, {"R1": (points, STRAIGHT)})
    return found


def test_a_body_stands_beside_a_wall_or_before_it_but_not_in_it() -> None:
    walls = learnt(scan())
    middle = WALL_M + THICK_M / 2
    for x, held in (
        (middle, True),
        (WALL_M - 0.3, False),
        (WALL_M + THICK_M + 0.35, False),
        (2.0, False),
    ):
        assert walls.holds(body(x)).tolist() == [held], x
    # A forklift that stands along the wall and touches it.
    assert not walls.holds(body(WALL_M - 0.62, sizes=(1.2, 2.5))).any()
    assert walls.holds(body(middle, sizes=(0.9, 2.5))).all()


def test_what_is_no_taller_than_an_object_is_no_structure() -> None:
    assert not len(learnt(scan(height_m=TALLEST_M - 0.1)))
    assert len(learnt(scan(height_m=TALLEST_M + 0.5)))


def test_without_a_tallest_object_nothing_is() -> None:
    walls = Structure(math.inf)
    walls.learn(0.0, {"R1": (scan(), STRAIGHT)})
    assert not len(walls)


def test_several_robots_show_it_where_they_stand() -> None:
    walls = Structure(TALLEST_M)
    for time_s in (0.0, 1.0):
        walls.learn(time_s, {"R1": (scan(), STRAIGHT), "R2": (scan(), HERE)})
    seen = HERE @ np.array([WALL_M + 0.15, 0.0, -0.3, 1.0])
    assert walls.holds(body(WALL_M + 0.15)).all()
    assert walls.holds(body(seen[0], seen[1])).all()


def test_it_is_forgotten_unless_somebody_shows_it_again() -> None:
    walls, wall, free = learnt(scan()), body(WALL_M + 0.15), scan(height_m=0.1)
    walls.learn(FORGOTTEN_S - 1.0, {"R1": (free, STRAIGHT)})
    assert walls.holds(wall).all()
    walls.learn(FORGOTTEN_S + 1.1, {"R1": (free, STRAIGHT)})
    assert not len(walls)
    again = learnt(scan())
    for second in range(1, 12):
        again.learn(float(second), {"R2": (scan(), STRAIGHT)})
    assert again.holds(wall).all()


def test_what_is_tall_and_drives_by_is_no_structure() -> None:
    walls = Structure(TALLEST_M)
    for second in range(6):
        away_m = 4.0 + second
        walls.learn(float(second), {"R1": (scan(away_m=away_m), STRAIGHT)})
        assert len(walls) > 0
        assert not walls.holds(body(away_m + 0.15)).any()
        # Nor is its trail.
        assert not walls.holds(body(away_m - 0.85)).any()


def test_a_robot_that_shows_it_ten_times_a_second_is_looked_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[int] = []

    def look(points: Points, tallest_m: float) -> NDArray[np.bool_]:
        looked.append(len(points))
        return above_objects(points, tallest_m)

    monkeypatch.setattr(structure, "above_objects", look)
    walls = Structure(TALLEST_M)
    for frame in range(20):
        walls.learn(frame / 10, {"R1": (scan(), STRAIGHT)})
    assert len(looked) == 2


def test_there_are_not_more_cells_than_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(structure, "MOST_CELLS", 50)
    walls = learnt(scan())
    walls.learn(2.0, {"R1": (scan(away_m=4.0), STRAIGHT)})
    assert len(walls) == 50
    # The newest are.
    assert not any(walls.holds(body(WALL_M + 0.15, float(y))).any() for y in range(-9, 10))


@given(st.floats(0.0, 1.0))
def test_a_box_in_a_wall_is_less_likely_by_bayes_rule(chance: float) -> None:
    walls = learnt(scan())
    found = walls.judged(
        Boxes.concatenate([body(WALL_M + 0.15, score=chance), body(2.0, score=chance)])
    )
    inside, beside = found.scores
    assert beside == chance
    assert 0.0 <= inside <= chance
    odds = LESS_LIKELY * chance * (1.0 - inside)
    assert inside * (1.0 - chance) == pytest.approx(odds, abs=1e-12)


def test_memory_tells_of_no_piece_of_a_wall_and_of_a_sure_body_in_it() -> None:
    told = {}
    for score in (0.35, 0.97):
        memory = Memory(1.0, TALLEST_M)
        for number in range(18):
            found = body(WALL_M + 0.15, score=score) if number > 10 else Boxes.empty()
            frame = Frame(
                number / 10, found, frozenset({"R2"}), {"R1": (scan(), STRAIGHT)}, STRAIGHT
            )
            told[score] = memory.update(frame).boxes.scores
    assert told[0.35].max(initial=0.0) < 0.15
    assert told[0.97].max() > 0.8


def test_a_jump_of_the_ego_forgets_walls() -> None:
    memory = Memory(1.0, TALLEST_M)
    frame = Frame(0.0, Boxes.empty(), frozenset(), {"R1": (scan(), STRAIGHT)}, STRAIGHT)
    memory.update(frame)
    jumped = Pose(0.0, 30.0, 1.2).matrix()
    for number in range(1, 5):
        found = body(WALL_M + 0.15, score=0.5)
        # Nothing of the wall is seen from there.
        there = Frame(number / 10, found, frozenset({"R2"}), {"R1": (scan(0.1), jumped)}, jumped)
        told = memory.update(there)
    assert told.boxes.scores[0] > 0.4


@pytest.mark.parametrize("seed", [1_981_700, 1_981_701, 1_981_702])
def test_no_true_object_of_a_floor_stands_in_its_walls(seed: int) -> None:
    world = open_world("factory", robots=6, seed=seed)
    walls, held, count = Structure(TALLEST_M), 0, 0
    for frame in range(0, 60, 10):
        scans = {robot: world.scan(robot, frame) for robot in world.robots}
        views = {robot: (one.points, one.pose.matrix()) for robot, one in scans.items()}
        walls.learn(frame / 10, views)
        truth = world.ground_truth(frame).boxes
        held, count = held + int(walls.holds(truth).sum()), count + len(truth)
    assert len(walls) > 500
    assert count > 50
    assert held == 0
