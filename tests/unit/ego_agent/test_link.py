"""C(t): the estimate follows the link and is not misled by what is not the link."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.monitor.evidence import FLOOR_BPS, MAX_QUEUES, Sample
from ego_agent.monitor.link import DOUBLING_S, OLD_LINK_S, STATE_FRESH_S, LinkEstimate

PRIOR = 55e6
REPORT_S = 0.5
EVER = 1e9


def filled(rate_bps: float) -> Sample:
    """A queue stood, and that left it meanwhile."""
    return Sample(rate_bps, filled=True, span_s=REPORT_S)


def carried(rate_bps: float) -> Sample:
    """A queue was empty most of the time."""
    return Sample(rate_bps, filled=False, span_s=REPORT_S)


def feed(link: LinkEstimate, sample: Sample, seconds: float, begun_s: float) -> float:
    """Reports of a router for so many seconds; returns when the last one came."""
    reports = round(seconds / REPORT_S)
    for i in range(1, reports + 1):
        link.add_cell(sample, begun_s + i * REPORT_S)
    return begun_s + reports * REPORT_S


def test_before_anything_was_measured_the_setting_counts() -> None:
    assert LinkEstimate(PRIOR).capacity(0.0) == (PRIOR, "prior")


def test_a_queue_that_stands_measures_the_link() -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, filled(5e6), 1.0, 1.0)
    assert link.capacity(now) == (pytest.approx(5e6), "measured")


def test_what_went_through_an_empty_queue_lowers_nothing() -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, carried(200e3), 60.0, 0.0)
    assert link.capacity(now) == (PRIOR, "prior")
    link.add_robot("R2", carried(100e3), now)
    assert link.robot_limits(now) == {}


@pytest.mark.parametrize("to_bps", [20e6, 5e6, 1e6, 300e3])
def test_a_drop_of_the_link_is_found_at_once(to_bps: float) -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, carried(30e6), 5.0, 0.0)
    now = feed(link, filled(to_bps), REPORT_S, now)
    assert link.capacity(now) == (pytest.approx(to_bps), "measured")


def test_where_the_shapers_queue_stood_the_link_carries_what_was_configured() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(20):
        now = i * REPORT_S
        link.set_state(5e6, now, stood=True)
        link.add_cell(filled(0.2e6), now + 0.1)
        assert link.capacity(now + 0.1) == (5e6, "net/state")
    assert link.error_ratio(now + 0.1) == pytest.approx(0.2 / 5 - 1)
    link.set_state(5e6, now + REPORT_S)
    link.add_cell(filled(0.2e6), now + 0.2)
    assert link.capacity(now + 0.2) == (5e6, "net/state")
    now = feed(link, filled(2e6), 1.0, now + REPORT_S)
    assert link.capacity(now) == (pytest.approx(2e6), "measured")


def test_where_the_shapers_queue_of_a_robots_link_stood_it_carries_what_was_configured() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(20):
        now = i * REPORT_S
        link.set_uplink("R2", 5e6, now, stood=True)
        link.add_robot("R2", filled(0.2e6), now + 0.1)
        assert link.robot_limits(now + 0.1) == {"R2": 5e6}


def test_a_steady_queue_gives_a_steady_estimate() -> None:
    link = LinkEstimate(PRIOR)
    found = []
    for i in range(40):
        link.add_cell(filled(5e6 * (1.05 if i % 2 else 0.95)), i * REPORT_S)
        found.append(link.capacity(i * REPORT_S)[0])
    assert max(found[2:]) <= 1.11 * min(found[2:])


def test_what_a_recovered_link_carries_at_least_raises_the_estimate_at_once() -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, filled(0.3e6), 2.0, 0.0)
    link.add_cell(carried(10e6), now + REPORT_S)
    assert link.capacity(now + REPORT_S)[0] == pytest.approx(10e6)


def test_a_queue_that_stands_may_show_more_than_the_prior() -> None:
    link = LinkEstimate(1e6)
    now = feed(link, filled(40e6), 1.0, 0.0)
    assert link.capacity(now) == (pytest.approx(40e6), "measured")


def test_silence_makes_the_estimate_decay_to_a_floor() -> None:
    link = LinkEstimate(PRIOR)
    rates = []
    for i in range(60):
        link.silence(i * 0.25)
        rates.append(link.capacity(i * 0.25)[0])
    assert rates == sorted(rates, reverse=True)
    assert rates[3] < PRIOR * 0.6
    assert FLOOR_BPS <= rates[-1] < 2 * FLOOR_BPS


def test_without_new_evidence_the_estimate_rises_to_the_prior_and_no_further() -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, filled(5e6), 1.0, 0.0)
    assert link.capacity(now + DOUBLING_S)[0] == pytest.approx(10e6)
    assert link.capacity(EVER) == (PRIOR, "prior")


def test_the_estimate_leaves_what_was_measured_slowly_and_then_ever_faster() -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, filled(0.5e6), 1.0, 0.0)
    after = [link.capacity(now + seconds)[0] / 0.5e6 for seconds in (2, 5, 10, 20)]
    assert after == pytest.approx([1.064, 2.0, 9.0, 65.0])


def test_a_robot_with_a_slow_link_of_its_own_lowers_its_own_estimate_only() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(10):
        link.add_robot("R5", filled(0.5e6), i * REPORT_S)
        link.add_cell(carried(1e6), i * REPORT_S)
    assert link.capacity(4.5) == (PRIOR, "prior")
    assert link.robot_limits(4.5) == {"R5": pytest.approx(0.5e6)}


def test_a_slow_cell_is_no_robots_doing() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(10):
        link.add_robot("R5", carried(0.5e6), i * REPORT_S)
        link.add_cell(filled(1e6), i * REPORT_S)
    assert link.capacity(4.5) == (pytest.approx(1e6), "measured")
    assert link.robot_limits(4.5) == {}


def test_a_robots_link_that_has_recovered_is_found_out() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(2):
        link.add_robot("R5", filled(0.5e6), i * REPORT_S)
    assert link.robot_limits(1.0)["R5"] < 1e6
    assert link.robot_limits(1.0 + 4 * DOUBLING_S)["R5"] > 5e6
    assert link.robot_limits(1.0 + 10 * DOUBLING_S) == {}


def test_the_links_of_a_flood_of_robots_cost_bounded_memory() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(2 * MAX_QUEUES):
        link.add_robot(f"X{i}", filled(1e5), 0.0)
    assert len(link.robot_limits(0.0)) == MAX_QUEUES


def test_the_controllers_word_bounds_a_robots_link() -> None:
    link = LinkEstimate(PRIOR)
    link.set_uplink("R2", 1e6, 0.0)
    link.set_uplink("R3", 80e6, 0.0)
    assert link.robot_limits(0.0) == {"R2": 1e6}
    link.set_uplink("R2", None, 0.0)
    assert link.robot_limits(0.0) == {}


def test_the_controllers_word_about_a_robots_link_goes_stale() -> None:
    link = LinkEstimate(PRIOR)
    link.set_uplink("R2", 1e6, 0.0)
    assert link.robot_limits(STATE_FRESH_S) == {"R2": 1e6}
    assert link.robot_limits(STATE_FRESH_S + 0.1) == {}


@pytest.mark.parametrize("said_bps", [10e6, None])
def test_a_robots_link_that_is_configured_anew_forgets_what_was_measured(
    said_bps: float | None,
) -> None:
    link = LinkEstimate(PRIOR)
    link.set_uplink("R5", 1e6, 0.0)
    for i in range(4):
        link.add_robot("R5", filled(0.5e6), 1.0 + i * REPORT_S)
    assert link.robot_limits(2.5)["R5"] < 0.7e6
    link.set_uplink("R5", said_bps, 3.0)
    for i in range(2):
        link.add_robot("R5", filled(0.5e6), 3.0 + i * 0.1)
    assert link.robot_limits(3.1) == ({} if said_bps is None else {"R5": said_bps})


def test_the_controllers_word_is_a_better_prior_and_a_ceiling_while_it_is_fresh() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    assert link.capacity(1.0) == (5e6, "net/state")
    now = feed(link, filled(40e6), 1.0, 1.0)
    assert link.capacity(now) == (5e6, "net/state")
    now = feed(link, filled(2e6), 2.0, now)
    assert link.capacity(now) == (pytest.approx(2e6), "measured")


@pytest.mark.parametrize("said_bps", [20e6, 1e6])
def test_a_new_word_of_the_controller_ends_what_was_measured_before(said_bps: float) -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    now = feed(link, filled(4e6), 1.0, 1.0)
    assert link.capacity(now)[1] == "measured"
    link.set_state(said_bps, now)
    assert link.capacity(now) == (said_bps, "net/state")


@pytest.mark.parametrize("unshaped", [True, False])
def test_what_was_on_its_way_over_the_old_link_says_nothing_about_the_new_one(
    unshaped: bool,
) -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(1e6, 0.0)
    if unshaped:
        link.clear_state(10.0)
    else:
        link.set_state(PRIOR, 10.0)
    for late_s in (0.1, 0.2, REPORT_S, REPORT_S + OLD_LINK_S - 0.01):
        link.add_cell(filled(0.9e6), 10.0 + late_s)
    assert link.capacity(10.8)[0] == PRIOR


def test_a_word_that_wavers_by_a_few_percent_does_not_end_what_was_measured() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    now = feed(link, filled(4e6), 1.0, 1.0)
    for i, said_bps in enumerate((5.2e6, 4.9e6, 5.1e6)):
        link.set_state(said_bps, now + 0.1 * i)
        assert link.capacity(now)[1] == "measured"


def test_a_rate_that_creeps_away_is_another_link_in_the_end() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    now = feed(link, filled(4e6), 1.0, 1.0)
    for i in range(12):
        link.set_state(5e6 * 1.1**i, now + 0.01 * i)
    assert link.capacity(now + 0.15) == (pytest.approx(5e6 * 1.1**11), "net/state")


def test_when_the_controller_dies_its_last_word_is_the_prior_and_tcps_view_goes_on() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    dead_s = STATE_FRESH_S + 1.0
    assert link.capacity(dead_s) == (5e6, "prior")
    now = feed(link, filled(2e6), 1.0, dead_s)
    assert link.capacity(now) == (pytest.approx(2e6), "measured")
    now = feed(link, filled(9e6), 2.0, now)
    assert link.capacity(now) == (pytest.approx(9e6), "measured")


def test_when_nobody_reports_any_more_the_last_measure_rises_and_never_falls() -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, filled(2e6), 1.0, 0.0)
    found = [link.capacity(now + i)[0] for i in range(40)]
    assert found == sorted(found)
    assert found[-1] == PRIOR


def test_a_cell_that_is_shaped_no_longer_is_as_wide_as_the_setting_says() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    now = feed(link, filled(4e6), 1.0, 1.0)
    link.clear_state(now)
    assert link.capacity(now) == (PRIOR, "prior")


def test_the_error_is_that_of_what_was_measured_and_not_of_what_is_reckoned_with() -> None:
    link = LinkEstimate(PRIOR)
    assert link.error_ratio(0.0) is None
    link.set_state(5e6, 0.0)
    assert link.error_ratio(0.0) is None
    now = feed(link, filled(6e6), 1.0, 1.0)
    assert link.capacity(now) == (5e6, "net/state")
    assert link.error_ratio(now) == pytest.approx(0.2)
    link.set_state(5e6, now + STATE_FRESH_S)
    assert link.error_ratio(now + STATE_FRESH_S + 1.0) is None


@given(
    st.lists(
        st.tuples(
            st.sampled_from(("cell", "R2", "R3", "silence", "state")),
            st.floats(FLOOR_BPS, 1e11),
            st.booleans(),
            st.floats(0, 5),
        ),
        max_size=60,
    )
)
def test_the_estimate_is_always_a_positive_number(
    steps: list[tuple[str, float, bool, float]],
) -> None:
    link = LinkEstimate(PRIOR)
    now = 0.0
    for what, rate_bps, full, after_s in steps:
        now += after_s
        sample = Sample(rate_bps, filled=full, span_s=after_s)
        if what == "cell":
            link.add_cell(sample, now)
        elif what == "silence":
            link.silence(now)
        elif what == "state":
            link.set_state(rate_bps, now)
        else:
            link.add_robot(what, sample, now)
        rate, _ = link.capacity(now)
        assert FLOOR_BPS <= rate < 1e12
        assert all(FLOOR_BPS <= limit < rate for limit in link.robot_limits(now).values())
