"""What two readings of a queue's counters show, and what they do not."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.evidence import MAX_QUEUES, MAX_SPAN_MS, MIN_STOOD_MS, Queues, Sample
from swarm.messages import Backlog


def at(seen_ms: int, sent: int, stood_ms: int = 0, stood_bytes: int = 0) -> Backlog:
    return Backlog(seen_ms=seen_ms, sent_bytes=sent, stood_ms=stood_ms, stood_bytes=stood_bytes)


def test_a_first_reading_shows_nothing() -> None:
    assert Queues().take("q", at(60_000, 9_000_000, 30_000, 9_000_000)) is None


def test_what_left_a_queue_that_stood_is_the_links_rate() -> None:
    queues = Queues()
    queues.take("q", at(1000, 50_000))
    assert queues.take("q", at(1500, 150_000, 200, 25_000)) == Sample(1e6, filled=True, span_s=0.5)


def test_what_went_through_an_empty_queue_is_carried_at_least() -> None:
    queues = Queues()
    queues.take("q", at(1000, 50_000))
    assert queues.take("q", at(1500, 112_500)) == Sample(1e6, filled=False, span_s=0.5)


def test_a_queue_that_stood_for_a_moment_did_not_fill_the_link() -> None:
    queues = Queues()
    queues.take("q", at(0, 0))
    shown = queues.take("q", at(500, 62_500, MIN_STOOD_MS - 1, 10))
    assert shown == Sample(1e6, filled=False, span_s=0.5)


def test_a_reading_that_was_lost_costs_nothing() -> None:
    queues = Queues()
    queues.take("q", at(0, 0))
    shown = queues.take("q", at(1500, 300_000, 900, 112_500))
    assert shown == Sample(1e6, filled=True, span_s=1.5)


@pytest.mark.parametrize(
    "again", [at(10, 0), at(3000, 400, 10, 10), at(3000, 900_000, 0, 0), at(10, 900_000, 700, 900)]
)
def test_counters_that_began_anew_show_nothing_until_the_next_reading(again: Backlog) -> None:
    queues = Queues()
    queues.take("q", at(2000, 500_000, 600, 400_000))
    assert queues.take("q", again) is None
    later = at(
        again.seen_ms + 500,
        again.sent_bytes + 62_500,
        again.stood_ms + 100,
        again.stood_bytes + 12_500,
    )
    assert queues.take("q", later) == Sample(1e6, filled=True, span_s=0.5)


def test_readings_that_lie_far_apart_do_not_tell_of_now() -> None:
    queues = Queues()
    queues.take("q", at(0, 0))
    assert queues.take("q", at(MAX_SPAN_MS + 1, 10_000_000, 5000, 10_000_000)) is None


def test_readings_that_lie_too_close_together_show_a_burst_and_are_not_used() -> None:
    queues = Queues()
    queues.take("q", at(1000, 0))
    assert queues.take("q", at(1010, 100_000)) is None


def test_a_dead_link_with_a_standing_queue_is_as_slow_as_can_be() -> None:
    queues = Queues()
    queues.take("q", at(0, 0))
    shown = queues.take("q", at(500, 0, 500, 0))
    assert shown is not None
    assert shown.filled
    assert shown.rate_bps > 0


def test_what_is_forgotten_begins_anew() -> None:
    queues = Queues()
    queues.take("q", at(0, 0))
    queues.forget("q")
    queues.forget("never heard of")
    assert queues.take("q", at(500, 62_500)) is None


def test_a_flood_of_queues_costs_bounded_memory() -> None:
    queues = Queues()
    for i in range(3 * MAX_QUEUES):
        queues.take(i, at(0, 0))
    assert len(queues._last) == MAX_QUEUES


numbers = st.integers(0, 2**63)


@given(st.lists(st.tuples(numbers, numbers, numbers, numbers), max_size=20))
def test_any_counters_give_a_positive_rate_or_none(readings: list[tuple[int, ...]]) -> None:
    queues = Queues()
    for reading in readings:
        shown = queues.take("q", at(*reading))
        assert shown is None or (shown.rate_bps > 0 and 0 <= shown.span_s <= MAX_SPAN_MS / 1e3)
