"""The budget of control traffic: what the link carries, and less while a queue stands."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ego_agent.knowledge.control_share import (
    FULL_BPS,
    NEEDED_BPS,
    SHARE,
    WELL_BPS,
    WELL_SHARE,
    control_bps,
)
from ego_agent.knowledge.model import Snapshot
from ego_agent.plan.control_budget import LEAST_BPS, ControlBudget, Wish, beacons_stand
from tests.support.ego_scenes import snapshot, view


def seen(capacity_bps: float = 55e6, delay_s: float = 0.01, robots: int = 5) -> Snapshot:
    others = [replace(view(f"R{i}", 5.0 * i), delay_s=delay_s) for i in range(1, robots + 1)]
    return snapshot(view("E"), *others, capacity_bps=capacity_bps)


def test_a_wide_link_limits_nobody() -> None:
    assert ControlBudget().take(seen(), 0.0) == Wish(0, {})


def test_a_narrow_link_shares_its_part_among_the_living() -> None:
    assert ControlBudget().take(seen(1.2e6), 0.0).each_bps == round(SHARE * 1.2e6 / 6)
    gone = seen(1.2e6)
    gone.robots["R1"] = replace(gone.robots["R1"], alive=False)  # type: ignore[index]
    assert ControlBudget().take(gone, 0.0).each_bps == round(SHARE * 1.2e6 / 5)


def test_where_their_share_is_scarce_robots_may_take_more_to_be_known_well() -> None:
    told = [ControlBudget().take(seen(bps), 0.0).each_bps for bps in (300e3, 140e3, 110e3, 60e3)]
    assert told == [WELL_BPS, round(WELL_SHARE * 140e3 / 6), NEEDED_BPS, NEEDED_BPS]


@pytest.mark.parametrize("link_bps", [60e3, 100e3, 300e3, 1e6, 5e6, 55e6])
def test_what_robots_take_of_a_link_leaves_the_c_t_by_which_they_may_take_it(
    link_bps: float,
) -> None:
    left_bps = link_bps - control_bps(link_bps, 6)
    each_bps = ControlBudget().take(seen(left_bps), 0.0).each_bps or FULL_BPS
    assert 5 * each_bps == pytest.approx(control_bps(link_bps, 6), rel=0.02)


def test_robots_get_what_they_need_to_be_known_before_observations_get_theirs() -> None:
    budget = ControlBudget()
    assert budget.take(seen(100e3), 0.0).each_bps == NEEDED_BPS
    assert budget.too_narrow == ""
    assert budget.take(seen(32e3), 1.0).each_bps < NEEDED_BPS
    assert budget.too_narrow == "C(t) of 32 kbit/s is too narrow for the beacons of 6 robots"


def test_a_queue_halves_what_robots_may_say_until_it_is_gone() -> None:
    budget = ControlBudget()
    told = [budget.take(seen(delay_s=3.0), float(t)).fewer_bps["R3"] for t in range(0, 20, 2)]
    assert told[0] == FULL_BPS / 2
    assert told == sorted(told, reverse=True)
    assert told[-1] == LEAST_BPS
    later = [budget.take(seen(), float(t)).fewer_bps.get("R3") for t in range(20, 60)]
    assert later[-1] is None
    assert LEAST_BPS < (later[0] or 0) < (later[10] or 0) < FULL_BPS


def test_a_slow_machine_does_not_silence_its_robots() -> None:
    budget = ControlBudget()
    told = [budget.take(seen(delay_s=0.6), float(t)) for t in range(0, 40, 2)]
    assert set(told[-1].fewer_bps.values()) == {NEEDED_BPS}


def test_beacons_stand_where_none_has_come_quickly_for_a_cycle() -> None:
    found = seen(delay_s=0.6)
    assert beacons_stand(found)
    quick = replace(found.robots["R1"], delay_s=0.01)
    found.robots["R1"] = quick  # type: ignore[index]
    assert not beacons_stand(found)
    found.robots["R1"] = replace(quick, unheard_s=1.5)  # type: ignore[index]
    assert beacons_stand(found), "it came quickly before the queue stood"
    found.robots["R1"] = replace(quick, alive=False)  # type: ignore[index]
    assert beacons_stand(found), "a robot that has left tells nothing"
    assert not beacons_stand(snapshot(view("E")))


def test_beacons_that_do_not_come_stand_in_a_queue_though_answers_tell_as_much() -> None:
    found = seen()
    found.robots["R1"] = replace(found.robots["R1"], unheard_s=3.0)  # type: ignore[index]
    assert ControlBudget().take(found, 0.0) == Wish(0, {"R1": FULL_BPS // 2})


def test_one_robot_behind_a_queue_of_its_own_changes_nothing_for_the_others() -> None:
    found = seen()
    found.robots["R1"] = replace(found.robots["R1"], delay_s=2.0)  # type: ignore[index]
    assert ControlBudget().take(found, 0.0) == Wish(0, {"R1": FULL_BPS // 2})
