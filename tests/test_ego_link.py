"""C(t): the estimate follows the link and is not misled by what is not the link."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.link import DOUBLING_S, FLOOR_BPS, STATE_FRESH_S, LinkEstimate, Round, busy_s

PRIOR = 55e6


def over(rate_bps: float, size: int, *, overhead_s: float = 0.0) -> Round:
    """A round of `size` bytes over a link of that rate."""
    return Round(delivered_bytes=size, busy_s=size * 8.0 / rate_bps + overhead_s, complete=True)


def nothing() -> Round:
    return Round(delivered_bytes=0, busy_s=0.25, complete=False)


def test_before_anything_was_measured_the_setting_counts() -> None:
    assert LinkEstimate(PRIOR).capacity(0.0) == (PRIOR, "prior")


def test_rounds_that_fill_the_link_measure_it() -> None:
    link = LinkEstimate(PRIOR)
    link.add_round(over(5e6, 100_000), 1.0)
    rate, source = link.capacity(1.0)
    assert rate == pytest.approx(5e6)
    assert source == "measured"


def test_the_link_is_busy_while_any_answer_is_on_its_way() -> None:
    assert busy_s([]) == 0.0
    assert busy_s([(1.0, 2.0), (1.5, 2.5), (4.0, 4.5)]) == pytest.approx(2.0)
    assert busy_s([(4.0, 4.5), (1.0, 5.0)]) == pytest.approx(4.0)


def test_small_rounds_cannot_lower_the_estimate() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(50):
        link.add_round(over(PRIOR, 700, overhead_s=0.03), i * 0.1)
    assert link.capacity(5.0) == (PRIOR, "prior")


def test_one_hiccup_of_a_busy_machine_lowers_nothing() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(20):
        link.add_round(over(PRIOR, 100_000, overhead_s=0.4 if i == 15 else 0.005), i * 0.1)
    assert link.capacity(2.0) == (PRIOR, "prior")


def test_a_drop_of_the_link_is_found_within_a_window_of_rounds() -> None:
    link = LinkEstimate(PRIOR)
    for i in range(20):
        link.add_round(over(PRIOR, 100_000), i * 0.1)
    for i in range(20, 30):
        link.add_round(over(5e6, 100_000), i * 0.1)
    assert link.capacity(3.0)[0] == pytest.approx(5e6, rel=0.05)


def test_a_filled_round_may_show_more_than_the_prior() -> None:
    link = LinkEstimate(1e6)
    link.add_round(over(40e6, 500_000), 1.0)
    assert link.capacity(1.0) == (pytest.approx(40e6), "measured")


def test_nothing_but_timeouts_makes_the_estimate_decay_to_a_floor() -> None:
    link = LinkEstimate(PRIOR)
    rates = []
    for i in range(60):
        link.add_round(nothing(), i * 0.25)
        rates.append(link.capacity(i * 0.25)[0])
    assert rates == sorted(rates, reverse=True)
    assert rates[3] < PRIOR * 0.6
    assert FLOOR_BPS <= rates[-1] < 2 * FLOOR_BPS


def test_a_refusal_says_nothing_about_the_link() -> None:
    link = LinkEstimate(PRIOR)
    link.add_round(Round(delivered_bytes=0, busy_s=0.1, complete=True), 1.0)
    assert link.capacity(1.0) == (PRIOR, "prior")


def test_without_new_evidence_the_estimate_rises_to_the_prior_and_no_further() -> None:
    link = LinkEstimate(PRIOR)
    link.add_round(over(5e6, 100_000), 0.0)
    assert link.capacity(DOUBLING_S)[0] == pytest.approx(10e6)
    assert link.capacity(1e6) == (PRIOR, "prior")


def test_the_controllers_word_is_a_better_prior_and_a_ceiling_while_it_is_fresh() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    assert link.capacity(1.0) == (5e6, "net/state")
    link.add_round(over(40e6, 500_000), 1.0)
    assert link.capacity(1.0) == (5e6, "net/state")
    for i in range(10):
        link.add_round(over(2e6, 500_000), 1.5 + i * 0.1)
    assert link.capacity(2.5) == (pytest.approx(2e6, rel=0.1), "measured")


def test_a_new_word_of_the_controller_ends_what_was_measured_before() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    link.add_round(over(4e6, 100_000), 0.5)
    assert link.capacity(0.5)[1] == "measured"
    link.set_state(20e6, 1.0)
    assert link.capacity(1.0) == (20e6, "net/state")


def test_the_last_word_of_a_controller_that_is_gone_stays_the_prior() -> None:
    link = LinkEstimate(PRIOR)
    link.set_state(5e6, 0.0)
    assert link.capacity(STATE_FRESH_S + 1.0) == (5e6, "prior")


@given(
    st.lists(
        st.builds(
            Round,
            delivered_bytes=st.integers(0, 8_000_000),
            busy_s=st.floats(0, 5),
            complete=st.booleans(),
        ),
        max_size=40,
    )
)
def test_the_estimate_is_always_a_positive_number(rounds: list[Round]) -> None:
    link = LinkEstimate(PRIOR)
    for i, done in enumerate(rounds):
        link.add_round(done, i * 0.1)
        rate, source = link.capacity(i * 0.1)
        assert FLOOR_BPS <= rate < 1e12
        assert source in ("measured", "prior")
