"""Cells of the floor: whatever place is asked for is in one of those that are given."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swarm.areas import CELL_M, MAX_INDEX, cell_of, cells_of_disc, cells_of_square, name_of

along = st.floats(-5_000.0, 5_000.0)
share = st.floats(-1.0, 1.0)


@example(0.0, -5e-324, 0.0, 0.0, 0.0)
@given(along, along, st.floats(0.0, 150.0), share, share)
def test_every_place_of_a_square_lies_in_its_cells(
    x: float, y: float, half_m: float, east: float, north: float
) -> None:
    assert cell_of(x + east * half_m, y + north * half_m) in cells_of_square(x, y, half_m)


@given(along, along, st.floats(0.0, 150.0), st.floats(0.0, 0.999), st.floats(0.0, math.tau))
def test_every_place_of_a_disc_lies_in_its_cells(
    x: float, y: float, radius_m: float, out: float, turn: float
) -> None:
    place = x + out * radius_m * math.cos(turn), y + out * radius_m * math.sin(turn)
    assert cell_of(*place) in cells_of_disc(x, y, radius_m)


def test_a_disc_leaves_out_the_corners_of_its_square() -> None:
    middle = CELL_M / 2.0
    assert cells_of_disc(middle, middle, 3 * CELL_M) < cells_of_square(middle, middle, 3 * CELL_M)
    assert cells_of_disc(middle, middle, 1.0) == {(0, 0)}


@pytest.mark.parametrize("far", [1e9, 1e308, math.inf])
def test_a_place_beyond_all_measure_is_in_an_outermost_cell(far: float) -> None:
    assert cell_of(far, -far) == (MAX_INDEX, -MAX_INDEX)
    assert name_of(cell_of(-far, far)) == "-99999_99999"
