"""Remembered objects go on turning, and drive where they head."""

from __future__ import annotations

import numpy as np
import pytest

from perception.memory.motion import Motions
from perception.memory.turning import Headings

LONG, SQUARE = np.array([False]), np.array([True])
SD = np.array([0.07])
FIRST = np.array([0])
WHOLE = np.array([False])


def followed(rate: float, square: bool = False, flips: bool = False) -> Headings:
    """Seen ten times in a second, while it turns at a rate; its front may be taken for its back."""
    headings = Headings()
    headings.add(np.array([0.0]), SD)
    for i in range(1, 11):
        headings.predict(0.1, np.array([square]))
        shown = rate * i / 10 + (np.pi if flips and i % 2 else 0.0)
        headings.update(FIRST, np.array([shown]), SD, np.array([square]))
    return headings


@pytest.mark.parametrize("flips", [False, True])
def test_what_turns_goes_on_turning_for_a_while(flips: bool) -> None:
    headings = followed(0.8, flips=flips)
    before = headings.headings()[0]
    assert before == pytest.approx(0.8, abs=0.1)
    headings.predict(0.5, LONG)
    assert before + 0.15 < headings.headings()[0] < before + 0.4
    headings.predict(20.0, LONG)
    assert headings.rates()[0] == pytest.approx(0.0, abs=1e-6)


def test_a_heading_lies_within_one_turn() -> None:
    assert 0.0 <= followed(-0.8).headings()[0] < 2.0 * np.pi


def test_the_turn_rate_of_what_is_as_long_as_wide_is_not_followed() -> None:
    headings = followed(0.8, square=True)
    before = headings.headings()[0]
    headings.predict(0.5, SQUARE)
    assert headings.headings()[0] == before == pytest.approx(0.8, abs=0.1)


def test_a_square_looks_the_same_after_a_quarter_turn() -> None:
    for square, expected in ((SQUARE, 0.02), (LONG, 0.1)):
        headings = Headings()
        headings.add(np.array([0.0]), SD)
        headings.update(FIRST, np.array([np.pi / 2.0 + 0.02]), SD, square)
        turned = headings.headings()[0]
        assert (turned <= expected) == bool(square[0])


def test_what_drives_in_a_bend_is_expected_on_it() -> None:
    speed, rate = 4.0, 0.5
    radius = speed / rate
    motions = Motions(6.0)
    motions.add(np.zeros((1, 2)), SD, np.zeros(1))
    for i in range(1, 21):
        motions.predict(0.1, np.array([rate]))
        angle = rate * i / 10
        there = radius * np.array([[np.sin(angle), 1.0 - np.cos(angle)]])
        motions.update(FIRST, there, SD, WHOLE)
    motions.predict(0.5, np.array([rate]))
    angle += rate * 0.5
    expected = radius * np.array([np.sin(angle), 1.0 - np.cos(angle)])
    assert np.hypot(*(motions.places()[0] - expected)) < 0.15
    velocity = motions.velocities()[0]
    assert np.arctan2(velocity[1], velocity[0]) == pytest.approx(angle, abs=0.1)


@pytest.mark.parametrize("anew", [False, True])
def test_of_another_part_that_is_seen_the_offset_is_not_known(anew: bool) -> None:
    motions = Motions(6.0)
    motions.add(np.zeros((1, 2)), SD, np.array([0.5]))
    for i in range(10):
        motions.predict(0.1, np.zeros(1))
        part = i % 5 != 0
        motions.update(FIRST, np.array([[2.0 * i / 10 + 0.5 * part, 0.0]]), SD, np.array([part]))
    if anew:
        motions.lose_offsets(FIRST)
    motions.predict(0.1, np.zeros(1))
    motions.update(FIRST, np.array([[2.0, 0.0]]), SD, np.array([True]))
    place = motions.places()[0, 0]
    assert place == pytest.approx(2.0, abs=0.1) if anew else place < 1.9
