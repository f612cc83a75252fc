"""Airtime of one cell, and many egos on one floor."""

from __future__ import annotations

import math

import pytest

from perception.metrics import precision_of
from research.benchmarks.egos import airtime, figures, floor_rows
from research.evaluation.airtime import group_s, jain, station_of
from research.evaluation.egos import Egos, Floor
from swarm.errors import EvaluationError


def test_a_cells_goodput_is_what_its_station_has_alone() -> None:
    near = station_of(55e6)
    assert 55e6 < near.rate_bps < 70e6
    # Full aggregates, without what TCP acknowledges, carry what the cell is named after.
    spent_s = 16 * 1500 * 8 / 55e6
    data_s = 16 * (1500 + 46) * 8 / near.rate_bps
    assert 0.0 < spent_s - data_s < 200e-6
    with pytest.raises(EvaluationError, match="pauses alone"):
        station_of(2e9)


def test_small_messages_are_dear_and_groups_are_slow() -> None:
    near = station_of(55e6)
    # A few bytes take more than a tenth of what 20 kB do.
    assert near.unicast_s(200) > 0.05 * near.unicast_s(20_000)
    assert near.unicast_s(200) > 200 * 8 / 55e6 * 5
    # The same bytes to a group take longer than to a station, and less than to five.
    one, group = near.unicast_s(4000), group_s(4000, 24e6)
    assert one < group < 5 * one
    assert group_s(4000, 6e6) > 2 * group


def test_the_index_of_fairness() -> None:
    assert jain([2.0, 2.0, 2.0]) == 1.0
    assert math.isclose(jain([1.0, 0.0, 0.0, 0.0]), 0.25)
    assert jain([]) == jain([0.0, 0.0]) == 1.0


def test_publishing_once_is_fused_alike_and_takes_less_of_the_medium() -> None:
    egos = Egos(Floor(0, 4, 16, (100,)))
    asked = egos.everybody("early")
    seen = egos.frame(100, asked)
    near = station_of(55e6)
    frame = airtime(asked, seen, lambda robot: near, 24e6)
    assert frame.published.all_s < 0.5 * frame.single.all_s
    copies = airtime(asked, seen, lambda robot: near, None)
    assert frame.published.down_s < copies.published.down_s
    for robot in egos.world.robots:
        sizes = {one.shared_bytes[robot] for ego, one in seen.items() if ego != robot}
        # One payload for all, at least as large as any that was made for one.
        assert len(sizes) == 1
        assert sizes.pop() >= 0.9 * max(
            one.single_bytes[robot] for ego, one in seen.items() if ego != robot
        )
    truths = sum(one.shared.truths for one in seen.values())
    assert truths
    assert (
        abs(
            precision_of([one.alone for one in seen.values()])
            - precision_of([one.shared for one in seen.values()])
        )
        < 0.2
    )


def test_each_ego_decides_within_its_part_of_the_cell() -> None:
    egos = Egos(Floor(1, 4, 16, (100,)))
    for each_bps in (50e3, 5e6):
        decided = egos.decisions(each_bps)
        assert set(decided) == set(egos.world.robots)
        assert all(one.fits for one in decided.values())


def test_the_figures_of_a_floor_are_those_that_the_report_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("research.benchmarks.egos.ROBOTS", 3)
    monkeypatch.setattr("research.benchmarks.egos.RINGS", 16)
    monkeypatch.setattr("research.benchmarks.egos.FRAMES", 1)
    found = figures(floor_rows(0))
    assert {"infeasible", "jain", "bytes_ratio", "delivered_difference"} <= found.keys()
    assert {"worst_ego_ap_70", "bytes_ratio_chosen"} <= found.keys()
    assert found["pairs"] == 6
    assert 0.0 < found["bytes_ratio"] < 1.0
    assert len(found["rows"]) == 10
