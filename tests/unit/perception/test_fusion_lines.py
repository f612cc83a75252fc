"""Laying outlines over lines: a rough correction becomes one of a centimetre."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from perception.fusion.alignment import PRIOR, Estimate
from perception.fusion.lines import CELL_M, Lines

Floats = NDArray[np.float64]

SENDER = np.array([4.0, 1.0])


def walls(step_m: float, first_m: float = 0.0) -> Floats:
    """A corner of two walls, places (N, 2)."""
    along = np.arange(first_m, 12.0, step_m)
    ahead = np.column_stack([np.full(len(along), 9.03), along - 6.0])
    aside = np.column_stack([along - 3.0, np.full(len(along), 6.07)])
    return np.concatenate([ahead, aside])


def believed(places: Floats, move: Floats) -> Floats:
    """Where a sender sees places that this move brings to where they are."""
    x, y, turn = move
    back = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    seen: Floats = (places - SENDER - [x, y]) @ back.T + SENDER
    return seen


def rough(*move: float) -> Estimate:
    return Estimate(np.array(move), PRIOR, 0.0)


@pytest.mark.parametrize(
    "move", [(0.2, -0.15, 0.004), (-0.3, 0.1, -0.006), (0.05, 0.05, 0.0), (0.0, 0.0, 0.01)]
)
def test_a_sender_is_put_right_to_a_centimetre(move: tuple[float, float, float]) -> None:
    lines = Lines(walls(0.02))
    seen = believed(walls(0.31, 0.1), np.array(move))
    found = lines.refine(rough(move[0] + 0.08, move[1] - 0.08, 0.0), seen, SENDER)
    assert found.move[:2] == pytest.approx(move[:2], abs=0.01)
    assert found.move[2] == pytest.approx(move[2], abs=math.radians(0.05))
    assert np.sqrt(np.diag(found.covariance))[:2].max() < 0.05


def test_a_move_that_brings_more_together_gains() -> None:
    lines, move = Lines(walls(0.02)), np.array([0.25, -0.2, 0.0])
    off = lines.refine(rough(0.2, -0.2, 0.0), believed(walls(0.31), move), SENDER)
    right = lines.refine(rough(0.05, 0.0, 0.0), walls(0.31), SENDER)
    assert off.gain > 4.0 > 1.0 > right.gain


def test_along_a_bare_wall_nothing_is_told() -> None:
    wall = np.column_stack([np.full(400, 9.03), np.linspace(-20.0, 20.0, 400)])
    seen = np.column_stack([np.full(40, 8.83), np.linspace(-6.0, 6.0, 40)])
    found = Lines(wall).refine(rough(0.1, 0.0, 0.0), seen, SENDER)
    assert found.move[:2] == pytest.approx([0.2, 0.0], abs=0.02)
    assert found.covariance[1, 1] == pytest.approx(PRIOR[1, 1], rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_where_there_are_no_lines_the_rough_estimate_stays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    crowd = rng.uniform(-10.0, 10.0, (30, 2))
    first = rough(0.2, 0.1, 0.0)
    assert Lines(crowd).refine(first, crowd[:2], SENDER) is first
    assert Lines(crowd[:3]).refine(first, walls(0.31), SENDER) is first
    assert Lines(walls(0.02)).refine(first, np.zeros((0, 2)), SENDER) is first


def test_others_that_see_more_make_more_lines() -> None:
    ahead = walls(0.02)[:600]
    seen, move = walls(0.31), np.array([0.0, 0.2, 0.0])
    alone = Lines(ahead).refine(rough(0.0, 0.1, 0.0), believed(seen, move), SENDER)
    both = Lines(ahead).and_of(walls(0.31, 0.05))
    joint = both.refine(rough(0.0, 0.1, 0.0), believed(seen, move), SENDER)
    assert joint.covariance[1, 1] < alone.covariance[1, 1]
    assert joint.move[1] == pytest.approx(0.2, abs=0.02)


def test_what_is_seen_is_thinned() -> None:
    many = np.random.default_rng(0).uniform(-3.0, 3.0, (100_000, 2))
    assert len(Lines(many)) <= (6.0 / CELL_M + 1) ** 2
