"""The ego's own points tell how an object has moved since others showed it whole."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.memory.memory import Frame, Memory
from perception.memory.registration import FRESH_S, LEAST, Cloud, Look, displaced
from perception.types import Boxes
from swarm.geometry import Points, Pose

SIZE = np.array([4.4, 1.8, 1.5])
SENSOR = Pose(-12.0, 3.0, 1.7, 0.0, 0.0, 0.4).matrix()
"""Behind the object, beside its way."""


def car(x: float, y: float = 0.0, heading: float = 0.0, score: float = 0.95) -> Boxes:
    return Boxes(
        np.array([[x, y, 0.75]]), SIZE[None], np.array([heading]), np.array([score]), ("car",)
    )


def seen(x: float, y: float = 0.0, heading: float = 0.0, seed: int = 0) -> Points:
    """Its back and one side, as the sensor sees them: (N, 3) in the sensor's frame."""
    rng = np.random.default_rng(seed)
    along, across = SIZE[:2] / 2.0
    back = np.column_stack([np.full(60, -along), rng.uniform(-across, across, 60)])
    side = np.column_stack([rng.uniform(-along, along, 120), np.full(120, across)])
    cos, sin = np.cos(heading), np.sin(heading)
    places = np.concatenate([back, side]) @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    ground = np.column_stack([rng.uniform(-9, 9, (900, 2)), np.zeros(900)])
    heights = rng.uniform(0.4, 1.4, len(places))
    ground += np.array([x, y, 0.0])
    world = np.concatenate([np.column_stack([places, heights]), ground])
    world += rng.normal(0.0, 0.01, world.shape)
    return ((world - SENSOR[:3, 3]) @ SENSOR[:3, :3]).astype(np.float32)


def look(x: float, heading: float = 0.0) -> Look:
    return Look(0.0, Cloud(seen(x, heading=heading), SENSOR), car(x, heading=heading))


@given(st.floats(-0.9, 0.9), st.floats(-0.2, 0.2), st.floats(0.0, 6.2))
def test_a_displacement_is_found(along: float, across: float, heading: float) -> None:
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = along * cos - across * sin, along * sin + across * cos
    now = Cloud(seen(x, y, heading, seed=1), SENSOR)
    found = displaced(look(0.0, heading), now, car(0.0, heading=heading), 0.4)
    assert found is not None
    assert found[0] == pytest.approx([x, y], abs=0.09)
    assert 0.05 < found[1] < 0.2


def test_of_an_object_that_is_hidden_now_nothing_is_told() -> None:
    assert displaced(look(0.0), Cloud(seen(40.0), SENSOR), car(0.0), 0.4) is None


@pytest.mark.parametrize("points", [np.zeros((0, 3), np.float32), seen(0.0)[:LEAST]])
def test_too_few_points_tell_nothing(points: Points) -> None:
    assert displaced(look(0.0), Cloud(points, SENSOR), car(0.0), 0.4) is None
    few = Look(0.0, Cloud(points, SENSOR), car(0.0))
    assert displaced(few, Cloud(seen(0.0), SENSOR), car(0.0), 0.4) is None


def test_what_is_beyond_all_tiles_is_no_error() -> None:
    far = Look(0.0, Cloud(seen(0.0), SENSOR), car(4000.0))
    assert displaced(far, Cloud(seen(0.0), SENSOR), car(-4000.0), 0.4) is None


def test_a_look_is_not_copied_with_the_memory() -> None:
    one = look(0.0)
    assert copy.deepcopy([one])[0] is one
    assert copy.deepcopy(one.cloud) is one.cloud


def followed(gap_s: float, hidden: bool = False, frames: int = 3) -> float:
    """By how much memory has a car wrong that R2 and the ego have shown whole for 2 s at 8 m/s, and
    after a gap the ego alone, by a box whose middle lies behind: it brakes then. `hidden`: none of
    the ego's points show it then."""
    memory = Memory(6.0)
    at, speed = 0.0, 8.0
    for i in range(21):
        at = speed * i / 10.0
        own = {"R1": (seen(at, seed=i), SENSOR)}
        memory.update(Frame(i / 10.0, car(at), frozenset({"R2"}), own))
    for i in range(frames):
        step_s = gap_s if i == 0 else 0.1
        speed = max(0.0, speed - 8.0 * step_s)
        at += speed * step_s
        own = {"R1": (seen(500.0 if hidden else at, seed=i), SENSOR)}
        time_s = 2.0 + gap_s + i / 10.0
        told = memory.update(Frame(time_s, car(at - 0.5, score=0.6), frozenset(), own))
    return float(np.hypot(*(told.boxes.centers[0, :2] - (at, 0.0))))


def test_who_brakes_while_others_are_silent_is_found_by_points() -> None:
    assert followed(0.1) < 0.7 * followed(0.1, hidden=True)


def test_what_was_shown_long_ago_is_not_looked_for() -> None:
    gap_s = FRESH_S + 0.1
    assert followed(gap_s, frames=1) == followed(gap_s, hidden=True, frames=1)
    assert followed(FRESH_S - 0.1, frames=1) != followed(FRESH_S - 0.1, hidden=True, frames=1)
