"""The clock offset: bounded from both sides, whatever the queues do."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.monitor.clock_offset import MAX_DRIFT, SYMMETRIC_NS, TOLERANCE_NS, ClockOffset

MS = 1_000_000
S = 1_000_000_000


@given(
    st.integers(-(10**15), 10**15),
    st.lists(
        st.tuples(st.integers(0, 20 * S), st.integers(0, 20 * S), st.integers(0, 60 * S)),
        min_size=1,
        max_size=40,
    ),
)
def test_no_queue_makes_a_message_look_fresher_than_half_the_symmetric_delay(
    truth: int, exchanges: list[tuple[int, int, int]]
) -> None:
    clock, now, arrived = ClockOffset(), 10**16, 0
    for up, down, pause in exchanges:
        asked = max(now, arrived) + pause
        heard = asked + up
        now = arrived = heard + down
        clock.heard(heard + truth, now)
        clock.echoed(asked, heard + truth, now)
        assert clock.now(now) - truth >= -SYMMETRIC_NS // 2
        least_up = min(one[0] for one in exchanges[: exchanges.index((up, down, pause)) + 1])
        span = now - 10**16
        assert clock.now(now) - truth <= least_up + MAX_DRIFT * span + TOLERANCE_NS


def test_without_echoes_the_quickest_message_counts_and_drifts_slowly() -> None:
    clock = ClockOffset()
    clock.heard(100 * S, 50 * S)
    for second in range(1, 121):
        clock.heard((100 + second) * S, (50 + second) * S + 3 * S)
    assert clock.now(170 * S) == pytest.approx(50 * S, abs=MAX_DRIFT * 120 * S + 1)


def test_a_clock_that_is_ahead_of_its_bounds_is_believed_at_once() -> None:
    clock = ClockOffset()
    clock.heard(10 * S, 10 * S)
    clock.echoed(9 * S, 9 * S, 10 * S)
    clock.heard(16 * S, 11 * S)
    assert clock.now(11 * S) == 5 * S


def test_a_clock_that_stood_still_is_found_by_the_next_echo() -> None:
    clock = ClockOffset()
    clock.heard(10 * S, 10 * S)
    clock.heard(11 * S, 16 * S)
    assert clock.now(16 * S) == pytest.approx(0, abs=2 * MS)
    clock.echoed(16 * S - 4 * MS, 11 * S - 2 * MS, 16 * S)
    assert clock.now(16 * S) == pytest.approx(-5 * S, abs=5 * MS)


def test_a_clock_of_which_nothing_is_known_is_the_egos() -> None:
    assert ClockOffset().now(5 * S) == 0
