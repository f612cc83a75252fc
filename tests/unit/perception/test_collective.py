"""The generation rules of collective perception, and what is held of what others told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.collective.generation import Generation, Seen
from perception.collective.received import HELD_S, MAX_HELD, Received
from perception.types import Boxes


def car(x: float = 0.0, vx: float = 0.0, vy: float = 0.0, id_: int = 1) -> Seen:
    return Seen(id_, False, x, 0.0, vx, vy)


def person(id_: int, x: float = 50.0) -> Seen:
    return Seen(id_, True, x, 0.0, 0.0, 0.0)


def told_at(rules: Generation, objects: list[list[Seen]], step_s: float = 0.1) -> list[int]:
    """The numbers of the frames in which a message tells of anything."""
    return [number for number, seen in enumerate(objects) if rules.due(number * step_s, seen)]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (car(), False),
        (car(x=4.0), False),
        (car(x=4.1), True),
        (car(vx=0.4), False),
        (car(vx=0.6), True),
    ],
)
def test_a_car_is_told_again_once_it_has_changed(change: Seen, told: bool) -> None:
    rules = Generation()
    assert rules.due(0.0, [car()]) == (0,)
    assert rules.due(0.1, [change]) == ((0,) if told else None)


@pytest.mark.parametrize(("degrees", "told"), [(3.9, False), (4.1, True), (-4.1, True)])
@pytest.mark.parametrize("speed", [0.4, 2.0])
def test_a_turn_counts_for_what_moves(speed: float, degrees: float, told: bool) -> None:
    rules = Generation()
    # Near the turn from pi to -pi, where angles jump.
    begin = math.pi - 0.01
    rules.due(0.0, [car(vx=speed * math.cos(begin), vy=speed * math.sin(begin))])
    end = begin + math.radians(degrees)
    turned = car(vx=speed * math.cos(end), vy=speed * math.sin(end))
    assert (rules.due(0.1, [turned]) is not None) is (told and speed > 1)


def test_what_stands_still_is_told_once_a_second() -> None:
    assert told_at(Generation(), [[car()]] * 31) == [0, 10, 20, 30]


def test_persons_are_told_together_twice_a_second() -> None:
    rules = Generation()
    assert rules.due(0.0, [person(1), car(), person(2)]) == (0, 1, 2)
    assert rules.due(0.1, [person(1), car(), person(2)]) is None
    # A new person brings all the others along, and not the car.
    assert rules.due(0.2, [person(1), car(), person(2), person(3)]) == (0, 2, 3)
    assert told_at(Generation(), [[person(1), person(2)]] * 12) == [0, 5, 10]


def test_messages_are_a_tenth_to_a_second_apart() -> None:
    rules = Generation()
    assert rules.due(0.0, []) == ()
    moving = [[car(x=5.0 * number)] for number in range(1, 4)]
    assert rules.due(0.05, moving[0]) is None
    assert rules.due(0.1, moving[0]) == (0,)
    assert rules.due(0.15, moving[1]) is None
    assert [rules.due(0.2 + 0.1 * n, []) for n in range(10)] == [None] * 9 + [()]


def test_a_clock_that_is_set_back_begins_anew() -> None:
    rules = Generation()
    rules.due(1000.0, [car()])
    assert rules.due(10.0, [car()]) == (0,)


def test_an_object_that_comes_back_is_new() -> None:
    rules = Generation()
    rules.due(0.0, [car()])
    assert rules.due(0.1, []) is None
    assert rules.due(0.2, [car()]) == (0,)


def test_what_others_told_as_it_is_is_not_worth_a_message() -> None:
    other = car(x=0.5, vx=2.0, id_=77)
    for mitigates, expected in ((True, None), (False, (0,))):
        rules = Generation(mitigates=mitigates)
        rules.due(-0.5, [])
        rules.hear(0.0, [other])
        # It has driven on as anybody would expect who heard of it.
        assert rules.due(0.4, [car(x=1.3, vx=2.0)]) == expected
    # Nobody expects it to stand; and what was told long ago counts no more.
    for now_s, seen in ((0.4, car(x=1.3)), (1.5, car(x=3.5, vx=2.0))):
        rules = Generation(mitigates=True)
        rules.due(-0.5, [])
        rules.hear(0.0, [other])
        assert rules.due(now_s, [seen]) == (0,)


def boxes(*x: float) -> Boxes:
    count = len(x)
    centers = np.array([(one, 0.0, 1.0) for one in x]).reshape(-1, 3)
    return Boxes(centers, np.ones((count, 3)), np.zeros(count), np.ones(count), ("car",) * count)


def test_what_was_told_is_held_and_moves_on() -> None:
    received = Received()
    velocities = np.array([[2.0, 1.0], [0.0, 0.0]])
    received.take(10.0, (7, 8), boxes(0.0, 30.0), velocities)
    received.take(10.5, (8,), boxes(31.0), velocities[1:])
    there = received.at(11.0)
    np.testing.assert_allclose(there.centers[:, :2], [[2.0, 1.0], [31.0, 0.0]])
    # An older message of another way says nothing new.
    received.take(10.2, (8,), boxes(0.0), velocities[1:])
    assert len(received.at(10.5 + HELD_S)) == 1
    assert received.at(10.5 + HELD_S).centers[0, 0] == 31.0
    assert not len(received.at(20.0))


def test_a_flood_of_objects_is_bounded() -> None:
    received = Received()
    for first in range(0, 4 * MAX_HELD, 256):
        ids = tuple(range(first, first + 256))
        received.take(first * 1e-3, ids, boxes(*map(float, ids)), np.zeros((256, 2)))
        assert len(received.at(first * 1e-3)) <= MAX_HELD
