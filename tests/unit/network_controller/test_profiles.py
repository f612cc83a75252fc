"""Capacities over time: the paper's shifts, recorded traces."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from network_controller.profiles import SINE_PERIOD_S, Fixed, Series, Shift


@pytest.mark.parametrize(
    ("hours_since_six", "tier"), [(0, 55e6), (5, 55e6), (6, 20e6), (11, 20e6), (12, 5e6), (20, 5e6)]
)
def test_a_working_day_has_three_shifts(hours_since_six: float, tier: float) -> None:
    # Whole waves of the ripple: only the tier is left.
    elapsed_s = round(hours_since_six * 3600 / SINE_PERIOD_S) * SINE_PERIOD_S
    assert Shift().rate_bps(elapsed_s) == pytest.approx(tier)


def test_the_night_ends_at_six() -> None:
    assert Shift().rate_bps(24 * 3600.0) == pytest.approx(55e6)


@given(st.floats(0, 1e6))
def test_the_ripple_is_15_percent(elapsed_s: float) -> None:
    assert any(0.85 <= Shift().rate_bps(elapsed_s) / tier <= 1.15 for tier in (55e6, 20e6, 5e6))


def test_the_ripple_reaches_its_crest_after_a_quarter_of_a_wave() -> None:
    assert Shift().rate_bps(SINE_PERIOD_S / 4) == pytest.approx(55e6 * 1.15)


def test_compressed_time_moves_the_shifts_and_not_the_ripple() -> None:
    fast = Shift(time_scale=3600.0)
    assert 17e6 <= fast.rate_bps(6.0) <= 23e6
    assert 4.25e6 <= fast.rate_bps(12.0) <= 5.75e6


def test_a_series_starts_again_at_its_end() -> None:
    series = Series((1, 2, 3), 0.5)
    assert [series.rate_bps(t / 2) for t in range(7)] == [1, 2, 3, 1, 2, 3, 1]


@given(st.integers(0, 10_000), st.sampled_from([0.1, 0.3, 0.5, 1.0, 7.0]))
def test_a_moment_at_which_a_series_changes_shows_the_new_rate(
    step: int, interval_s: float
) -> None:
    series = Series(tuple(range(10_002)), interval_s)
    assert series.rate_bps(step * interval_s) == step
    change_s = series.next_change_s(step * interval_s)
    assert change_s is not None
    assert series.rate_bps(change_s) == step + 1


def test_a_fixed_rate_never_changes() -> None:
    assert Fixed(5).rate_bps(1e9) == 5
    assert Fixed(5).next_change_s(0.0) is None
