"""C(t): the estimate follows the link and is not misled by what is not the link."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.link import DOUBLING_S, STATE_FRESH_S, LinkEstimate
from ego_agent.rounds import FLOOR_BPS, Round, Transfer, measure

PRIOR = 55e6
FRAME_S = 0.1
SIZE = 12_000
ROBOTS = ("R2", "R3", "R4", "R5")


def round_of(*transfers: Transfer, begun_s: float) -> Round:
    found = measure(transfers, begun_s)
    assert found is not None
    return found


def shared(
    rate_bps: float, begun_s: float, robots: tuple[str, ...] = ROBOTS, size: int = SIZE
) -> Round:
    """The robots' answers share a link of that rate fairly."""
    took_s = len(robots) * size * 8.0 / rate_bps
    return round_of(
        *(Transfer(r, size, begun_s, begun_s + took_s) for r in robots), begun_s=begun_s
    )


def straggling(
    slow_bps: float, begun_s: float, slow: str = "R5", *, others: tuple[str, ...] = ("R2", "R3")
) -> Round:
    """A robot comes in over a slow link of its own; the others take 5 ms."""
    quick = [Transfer(r, SIZE, begun_s, begun_s + 0.005) for r in others]
    tail = Transfer(slow, SIZE, begun_s, begun_s + SIZE * 8.0 / slow_bps)
    return round_of(*quick, tail, begun_s=begun_s)


def feed(link: LinkEstimate, rate_bps: float, seconds: float, begun_s: float) -> float:
    """Frames over a link of that rate for so many seconds; returns when the last one was over."""
    now, end = begun_s, begun_s + seconds
    over = begun_s
    while now < end:
        done = shared(rate_bps, now)
        over = now + len(ROBOTS) * SIZE * 8.0 / rate_bps
        link.add_round(done, over)
        now = max(now + FRAME_S, over)
    return over


def test_before_anything_was_measured_the_setting_counts() -> None:
    assert LinkEstimate(PRIOR).capacity(0.0) == (PRIOR, "prior")


def test_rounds_that_fill_the_link_measure_it() -> None:
    link = LinkEstimate(PRIOR)
    link.add_round(shared(5e6, 1.0), 1.1)
    assert link.capacity(1.1) == (pytest.approx(5e6), "measured")


def test_small_rounds_cannot_lower_the_estimate() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(50):
        link.add_round(shared(PRIOR / 1000, i * 0.1, size=50), i * 0.1 + 0.03)
    assert link.capacity(5.0) == (PRIOR, "prior")


def test_boxes_that_a_busy_machine_delays_do_not_lower_the_estimate() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(50):
        boxes = [Transfer(r, 300, i * 0.3, i * 0.3 + 0.04 * n) for n, r in enumerate(ROBOTS, 3)]
        link.add_round(round_of(*boxes, begun_s=i * 0.3), i * 0.3 + 0.24)
    assert link.capacity(15.0) == (PRIOR, "prior")
    assert link.robot_limits(15.0) == {}


def test_one_hiccup_of_a_busy_machine_lowers_nothing() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(20):
        link.add_round(shared(1e6 if i == 15 else PRIOR, i * 0.1), i * 0.1)
    assert link.capacity(2.0) == (PRIOR, "prior")
    assert link.robot_limits(2.0) == {}


@pytest.mark.parametrize("to_bps", [20e6, 5e6, 1e6, 300e3])
def test_a_drop_of_the_link_is_found_within_two_cycles(to_bps: float) -> None:
    link = LinkEstimate(PRIOR)
    feed(link, PRIOR, 5.0, 0.0)
    fits = len(ROBOTS) * SIZE * 8.0 <= to_bps * 0.05
    over = feed(link, to_bps, 1.9, 5.0)
    rate, _ = link.capacity(over)
    assert fits or rate == pytest.approx(to_bps, rel=0.05)
    assert over <= 7.0 or to_bps < 1e6


def test_after_a_hiccup_that_was_believed_quick_rounds_raise_the_estimate_at_once() -> None:
    link = LinkEstimate(PRIOR)
    link.add_round(shared(0.3e6, 0.0), 1.3)
    assert link.capacity(1.3)[0] == pytest.approx(0.3e6)
    link.add_round(shared(PRIOR, 1.4), 1.41)
    assert 10e6 < link.capacity(1.41)[0] < PRIOR


def test_a_burst_through_a_shapers_bucket_shows_no_more_than_the_link_carries() -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, 5e6, 2.0, 0.0)
    # 12 kB that pass a bucket of 20 ms at 5 Mbit/s in a moment.
    link.add_round(round_of(Transfer("R2", 12_000, now, now + 0.001), begun_s=now), now)
    assert link.capacity(now)[0] == pytest.approx(5e6, rel=0.05)


def test_a_filled_round_may_show_more_than_the_prior() -> None:
    link = LinkEstimate(1e6)
    link.add_round(shared(40e6, 1.0, size=100_000), 1.1)
    assert link.capacity(1.1) == (pytest.approx(40e6), "measured")


def test_nothing_but_silence_makes_the_estimate_decay_to_a_floor() -> None:
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
    link.add_round(shared(5e6, 0.0), 0.0)
    assert link.capacity(DOUBLING_S)[0] == pytest.approx(10e6)
    assert link.capacity(1e6) == (PRIOR, "prior")


def test_a_robot_with_a_slow_link_of_its_own_lowers_its_own_estimate_only() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(20):
        link.add_round(straggling(0.5e6, i * 0.3), i * 0.3 + 0.2)
        assert link.capacity(i * 0.3 + 0.2) == (PRIOR, "prior")
    assert link.robot_limits(6.0) == {"R5": pytest.approx(0.5e6, rel=0.05)}


def test_a_slow_robot_takes_nothing_from_what_a_filled_cell_shows() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(10):
        begun = i * 1.0
        # Two share 2 Mbit/s for 96 ms; the third comes in at 0.1 Mbit/s.
        others = [Transfer(r, SIZE, begun, begun + 0.096) for r in ("R2", "R3")]
        slow = Transfer("R5", SIZE, begun, begun + 0.96)
        link.add_round(round_of(*others, slow, begun_s=begun), begun + 0.96)
    assert link.capacity(9.96) == (pytest.approx(2e6), "measured")
    assert link.robot_limits(9.96) == {"R5": pytest.approx(0.1e6)}


def test_robots_that_share_a_slow_cell_are_not_taken_for_slow() -> None:
    link = LinkEstimate(PRIOR)
    now = feed(link, 2e6, 3.0, 0.0)
    assert link.robot_limits(now) == {}


def test_a_robot_that_is_alone_is_to_blame_where_the_controller_knows_the_cell_is_wide() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(20e6, 0.0)
    for i in range(10):
        link.add_round(straggling(0.5e6, i * 0.2, others=()), i * 0.2 + 0.192)
        link.set_state(20e6, i * 0.2 + 0.192)
    assert link.capacity(2.0) == (20e6, "net/state")
    assert link.robot_limits(2.0) == {"R5": pytest.approx(0.5e6, rel=0.05)}


def test_a_robot_that_is_known_to_be_slow_says_nothing_of_the_cell_when_it_is_alone() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(5):
        link.add_round(straggling(0.5e6, i * 0.2), i * 0.2 + 0.192)
    for i in range(5, 10):
        link.add_round(straggling(0.5e6, i * 0.2, others=()), i * 0.2 + 0.192)
    assert link.capacity(2.0) == (PRIOR, "prior")


def test_without_anything_to_compare_with_a_lone_slow_robot_is_the_cell() -> None:
    link = LinkEstimate(PRIOR)
    link.add_round(straggling(0.5e6, 0.0, others=()), 0.2)
    assert link.capacity(0.2)[0] == pytest.approx(0.5e6)
    assert link.robot_limits(0.2) == {}


def test_a_robots_link_that_has_recovered_is_found_out() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(5):
        link.add_round(straggling(0.5e6, i * 0.2), i * 0.2 + 0.192)
    assert link.robot_limits(1.0)["R5"] < 1e6
    assert link.robot_limits(1.0 + 4 * DOUBLING_S)["R5"] > 5e6
    assert link.robot_limits(1.0 + 10 * DOUBLING_S) == {}


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


def test_a_robots_link_that_is_configured_anew_forgets_what_was_measured() -> None:
    link = LinkEstimate(PRIOR)
    link.set_uplink("R5", 1e6, 0.0)
    for i in range(5):
        link.add_round(straggling(0.5e6, i * 0.2), i * 0.2 + 0.192)
    assert link.robot_limits(1.0)["R5"] < 0.7e6
    link.set_uplink("R5", 10e6, 1.0)
    assert link.robot_limits(1.0) == {"R5": 10e6}


def test_the_controllers_word_is_a_better_prior_and_a_ceiling_while_it_is_fresh() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    assert link.capacity(1.0) == (5e6, "net/state")
    link.add_round(shared(40e6, 1.0, size=100_000), 1.1)
    assert link.capacity(1.1) == (5e6, "net/state")
    now = feed(link, 2e6, 2.0, 1.5)
    assert link.capacity(now) == (pytest.approx(2e6, rel=0.1), "measured")


@pytest.mark.parametrize("said_bps", [20e6, 1e6])
def test_a_new_word_of_the_controller_ends_what_was_measured_before(said_bps: float) -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    link.add_round(shared(4e6, 0.4), 0.5)
    assert link.capacity(0.5)[1] == "measured"
    link.set_state(said_bps, 1.0)
    assert link.capacity(1.0) == (said_bps, "net/state")


def test_a_word_that_wavers_by_a_few_percent_does_not_end_what_was_measured() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    now = feed(link, 4e6, 1.0, 0.0)
    for i, said_bps in enumerate((5.2e6, 4.9e6, 5.1e6)):
        link.set_state(said_bps, now + 0.1 * i)
        assert link.capacity(now)[1] == "measured"


def test_a_rate_that_creeps_away_is_another_link_in_the_end() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    link.add_round(shared(4e6, 0.4), 0.5)
    for i in range(12):
        link.set_state(5e6 * 1.1**i, 0.5 + 0.01 * i)
    assert link.capacity(0.65) == (pytest.approx(5e6 * 1.1**11), "net/state")


def test_the_last_word_of_a_controller_that_is_gone_stays_the_prior() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    assert link.capacity(STATE_FRESH_S + 1.0) == (5e6, "prior")


def test_a_cell_that_is_shaped_no_longer_is_as_wide_as_the_setting_says() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    now = feed(link, 4e6, 1.0, 0.0)
    link.clear_state()
    assert link.capacity(now) == (PRIOR, "prior")


def test_the_error_is_that_of_what_was_measured_and_not_of_what_is_reckoned_with() -> None:
    link = LinkEstimate(PRIOR)
    assert link.error_ratio(0.0) is None
    link.set_state(5e6, 0.0)
    assert link.error_ratio(0.0) is None
    link.add_round(shared(6e6, 0.1), 0.2)
    assert link.capacity(0.2) == (5e6, "net/state")
    assert link.error_ratio(0.2) == pytest.approx(0.2)
    assert link.error_ratio(0.2 + STATE_FRESH_S + 1.0) is None


@given(
    st.lists(
        st.lists(
            st.tuples(
                st.sampled_from(ROBOTS),
                st.integers(0, 8_000_000),
                st.floats(-1, 1),
                st.floats(0, 5),
            ),
            max_size=8,
        ),
        max_size=30,
    )
)
def test_the_estimate_is_always_a_positive_number(
    rounds: list[list[tuple[str, int, float, float]]],
) -> None:
    link = LinkEstimate(PRIOR)
    for i, answers in enumerate(rounds):
        now = i * 0.1
        done = measure([Transfer(r, n, now + s, now + s + t) for r, n, s, t in answers], now)
        if done is None:
            link.silence(now)
        else:
            link.add_round(done, now)
        rate, source = link.capacity(now)
        assert FLOOR_BPS <= rate < 1e12
        assert source in ("measured", "prior")
        assert all(FLOOR_BPS <= limit < rate for limit in link.robot_limits(now).values())
