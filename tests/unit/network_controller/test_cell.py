"""One medium that several egos share: who gets what of it, and when that changes."""

from __future__ import annotations

import pytest

from network_controller.cell import Cell

EGOS = ("A", "B", "C", "D")
NEAR = dict.fromkeys(EGOS, 8e6)
"""All as near as can be: the cell carries 8 Mbit/s."""


def test_nobody_shares_with_nobody() -> None:
    for cell in (Cell(), Cell(("A",))):
        assert cell.part("A") == 1.0
        assert not cell.divide({"A": 1e6}, {"A": 9e9})
        assert cell.grants({"A": 1e6}) == {}
        assert cell.egos == ()
        assert not cell.use({"A"})


def test_all_have_equal_parts_until_they_say_what_they_need() -> None:
    cell = Cell(EGOS)
    assert [cell.part(ego) for ego in EGOS] == [0.25] * 4
    assert cell.part("R9") == 1.0
    assert cell.grants(NEAR) == dict.fromkeys(EGOS, 2_000_000)


def test_an_ego_that_asks_for_ten_times_its_part_takes_nothing_from_the_others() -> None:
    cell = Cell(EGOS)
    assert not cell.divide(NEAR, {"A": 20e6, "B": 2e6, "C": 2e6, "D": 2e6})
    assert cell.grants(NEAR) == dict.fromkeys(EGOS, 2_000_000)
    # It has what they do not need: what each needs is served first, and the rest is its own.
    assert cell.divide(NEAR, {"A": 20e6, "B": 1e6, "C": 1e6, "D": 1e6})
    grants = cell.grants(NEAR)
    assert grants["A"] == pytest.approx(5e6, rel=0.01)
    assert grants["B"] == grants["C"] == grants["D"] == pytest.approx(1e6, rel=0.01)


def test_what_is_left_over_is_everybodys_and_the_silent_ones_too() -> None:
    cell = Cell(EGOS)
    assert cell.divide(NEAR, {"A": 4e6})
    assert cell.part("A") == pytest.approx(0.625)
    assert cell.part("D") == pytest.approx(0.125)
    # An ego that needs nothing is heard all the same where others need everything.
    assert cell.divide(NEAR, {"A": 8e6, "B": 8e6, "C": 8e6})
    assert 0.02 < cell.part("D") < 0.03
    assert sum(cell.part(ego) for ego in EGOS) == pytest.approx(1.0)


def test_parts_stay_while_needs_move_a_little() -> None:
    cell = Cell(EGOS)
    assert cell.divide(NEAR, {"A": 4e6})
    assert not cell.divide(NEAR, {"A": 4.1e6})
    assert cell.divide(NEAR, {"A": 1e6})
    assert not cell.divide({}, {"A": 1e6})


def test_airtime_is_divided_not_bits() -> None:
    cell = Cell(("A", "B"))
    rates = {"A": 54e6, "B": 12e6}
    # Both want more than there is: half of the time each, at their own rates.
    assert not cell.divide(rates, {"A": 54e6, "B": 12e6})
    assert cell.grants(rates) == {"A": 27_000_000, "B": 6_000_000}
    # 3 Mbit/s are a quarter of the far one's time; the rest of it is the near one's.
    assert cell.divide(rates, {"A": 54e6, "B": 3e6})
    assert cell.grants(rates)["A"] == pytest.approx(0.75 * 54e6)
    assert cell.grants(rates)["B"] == pytest.approx(3e6)


def test_what_a_medium_carries_follows_from_who_uses_it() -> None:
    cell = Cell(("A", "B"))
    rates = {"A": 54e6, "B": 12e6}
    assert cell.carries_bps(rates) == 33e6
    assert cell.use({"A"})
    assert not cell.use({"A"})
    assert cell.carries_bps(rates) == 54e6
    # While only the far one sends, the near one keeps its guarantee.
    assert cell.use({"B"})
    assert cell.carries_bps(rates) == 27e6
    assert cell.use(())
    assert cell.carries_bps(rates) == 33e6
    assert cell.carries_bps({}) == 0


@pytest.mark.parametrize("busy", [(), ("A",), ("A", "B", "C", "D")])
def test_where_all_are_near_it_always_carries_the_same(busy: tuple[str, ...]) -> None:
    cell = Cell(EGOS)
    cell.divide(NEAR, {"A": 4e6})
    cell.use(busy)
    assert cell.carries_bps(NEAR) == pytest.approx(8e6, abs=1)


def test_a_link_that_nobody_wants_shaped_needs_nothing() -> None:
    cell = Cell(("A", "B"))
    assert cell.divide({"A": 8e6}, {"A": 8e6, "B": 8e6})
    assert cell.grants({"A": 8e6})["B"] == 0
    assert cell.carries_bps({"A": 8e6}) == 8e6
