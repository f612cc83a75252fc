"""One medium that several egos share: who gets what of it, and when that changes."""

from __future__ import annotations

import pytest

from network_controller.cell import Cell

EGOS = ("A", "B", "C", "D")


def test_nobody_shares_with_nobody() -> None:
    for cell in (Cell(), Cell(("A",))):
        assert cell.part("A") == 1.0
        assert not cell.divide(1e6, {"A": 9e9})
        assert cell.grants(1_000_000) == {}


def test_all_have_equal_parts_until_they_say_what_they_need() -> None:
    cell = Cell(EGOS)
    assert [cell.part(ego) for ego in EGOS] == [0.25] * 4
    assert cell.part("R9") == 1.0
    assert cell.grants(8_000_000) == dict.fromkeys(EGOS, 2_000_000)


def test_an_ego_that_asks_for_ten_times_its_part_takes_nothing_from_the_others() -> None:
    cell = Cell(EGOS)
    assert not cell.divide(8e6, {"A": 20e6, "B": 2e6, "C": 2e6, "D": 2e6})
    assert cell.grants(8_000_000) == dict.fromkeys(EGOS, 2_000_000)
    # It has what they do not need: what each needs is served first, and the rest is its own.
    assert cell.divide(8e6, {"A": 20e6, "B": 1e6, "C": 1e6, "D": 1e6})
    grants = cell.grants(8_000_000)
    assert grants["A"] == pytest.approx(5e6, rel=0.01)
    assert grants["B"] == grants["C"] == grants["D"] == pytest.approx(1e6, rel=0.01)


def test_what_is_left_over_is_everybodys_and_the_silent_ones_too() -> None:
    cell = Cell(EGOS)
    assert cell.divide(8e6, {"A": 4e6})
    assert cell.part("A") == pytest.approx(0.625)
    assert cell.part("D") == pytest.approx(0.125)
    # An ego that needs nothing is heard all the same where others need everything.
    assert cell.divide(8e6, {"A": 8e6, "B": 8e6, "C": 8e6})
    assert 0.02 < cell.part("D") < 0.03
    assert sum(cell.part(ego) for ego in EGOS) == pytest.approx(1.0)


def test_parts_stay_while_needs_move_a_little() -> None:
    cell = Cell(EGOS)
    assert cell.divide(8e6, {"A": 4e6})
    assert not cell.divide(8e6, {"A": 4.1e6})
    assert cell.divide(8e6, {"A": 1e6})
    assert not cell.divide(0.0, {"A": 1e6})
