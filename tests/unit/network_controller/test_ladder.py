"""How capacity is divided, level by level, and shared between egos."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from network_controller import ladder
from network_controller.fairness import max_min
from swarm.traffic import TrafficClass

CONTROL, FUSION, BACKGROUND = TrafficClass
levels = st.integers(0, ladder.TOP)
capacities = st.integers(100_000, 10_000_000_000)


@given(capacities, levels)
def test_guarantees_never_exceed_the_capacity(capacity: int, level: int) -> None:
    classes = ladder.shape(capacity, level).classes
    assert sum(one.rate_bps for one in classes.values()) <= capacity
    assert {one.ceil_bps for one in classes.values()} == {capacity}


@given(capacities, levels)
def test_control_is_never_starved(capacity: int, level: int) -> None:
    classes = ladder.shape(capacity, level).classes
    assert classes[CONTROL].priority < classes[FUSION].priority
    assert classes[CONTROL].rate_bps == ladder.shape(capacity, 0).classes[CONTROL].rate_bps


def test_the_first_step_raises_priority_and_the_others_move_rate_down_to_a_floor() -> None:
    shapes = [ladder.shape(1_000_000, level).classes for level in range(ladder.TOP + 1)]
    assert shapes[0][FUSION].priority == shapes[0][BACKGROUND].priority
    assert shapes[1][FUSION].priority < shapes[1][BACKGROUND].priority
    assert shapes[0][FUSION].rate_bps == shapes[1][FUSION].rate_bps
    fusion = [shape[FUSION].rate_bps for shape in shapes[1:]]
    background = [shape[BACKGROUND].rate_bps for shape in shapes[1:]]
    assert fusion == sorted(set(fusion))
    assert background == sorted(set(background), reverse=True)
    assert background[-1] == 50_000


@pytest.mark.parametrize("level", [-1, ladder.TOP + 1])
def test_there_are_no_other_levels(level: int) -> None:
    with pytest.raises(ValueError, match=str(level)):
        ladder.shape(1_000_000, level)


@given(capacities, levels)
def test_a_level_is_recognised_by_its_division(capacity: int, level: int) -> None:
    assert ladder.level_of(capacity, ladder.shape(capacity, level).classes) == level


@given(capacities, st.floats(0, 2), st.floats(0, 2))
def test_each_level_gives_fusion_at_least_as_much(
    capacity: int, control: float, background: float
) -> None:
    gives = [
        ladder.available_bps(capacity, level, control * capacity, background * capacity)
        for level in range(ladder.TOP + 1)
    ]
    assert gives == sorted(gives)
    assert gives[0] >= ladder.shape(capacity, 0).classes[FUSION].rate_bps
    assert gives[-1] <= capacity


def test_an_idle_link_is_all_for_fusion() -> None:
    assert ladder.available_bps(5_000_000, 0, 0.0, 0.0) == 5_000_000


def test_telemetry_that_wants_everything_gets_half_of_the_rest_at_level_0() -> None:
    assert ladder.available_bps(5_000_000, 0, 500_000, math.inf) == 2_250_000
    assert ladder.available_bps(5_000_000, 1, 500_000, math.inf) == 3_250_000
    assert ladder.available_bps(5_000_000, 3, 500_000, math.inf) == 4_250_000


demands = st.dictionaries(st.sampled_from("ABCDEF"), st.floats(0, 1e9), min_size=1)


@given(st.floats(0, 1e9), demands)
def test_a_fair_division_gives_all_there_is_and_no_more(
    capacity: float, needs: dict[str, float]
) -> None:
    grants = max_min(capacity, needs)
    assert sum(grants.values()) == pytest.approx(capacity, abs=1e-3)
    assert grants.keys() == needs.keys()


@given(st.floats(0, 1e9), demands)
def test_nobody_who_lacks_something_has_less_than_another(
    capacity: float, needs: dict[str, float]
) -> None:
    grants = max_min(capacity, needs)
    for ego, grant in grants.items():
        if grant < needs[ego] - 1e-3:
            assert grant >= max(grants.values()) - 1e-3


def test_who_needs_little_gets_it_and_the_others_share() -> None:
    assert max_min(10.0, {"A": 2.0, "B": math.inf, "C": 100.0}) == {"A": 2.0, "B": 4.0, "C": 4.0}
