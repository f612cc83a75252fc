"""What readings of a queue's counters show, and what they do not."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.monitor.evidence import MAX_QUEUES, MAX_SPAN_MS, MIN_STOOD_MS, Queues, Sample
from swarm.messages import Backlog


def at(seen_ms: int, sent: int, stood_ms: int = 0, stood_bytes: int = 0) -> Backlog:
    return Backlog(seen_ms=seen_ms, sent_bytes=sent, stood_ms=stood_ms, stood_bytes=stood_bytes)


def test_a_first_reading_shows_nothing() -> None:
    assert Queues().take("q", at(60_000, 9_000_000, 30_000, 9_000_000)) is None


def carried(rate_bps: float, span_s: float) -> Sample:
    return Sample(rate_bps, filled=False, span_s=span_s)


def test_what_left_a_queue_that_stood_is_the_links_rate() -> None:
    queues = Queues()
    queues.take("q", at(1000, 50_000))
    queues.take("q", at(1500, 150_000, 200, 20_000))
    shown = queues.take("q", at(2000, 250_000, 400, 50_000))
    assert shown == Sample(1e6, filled=True, span_s=1.0)


def test_a_queue_that_stood_between_two_readings_only_proves_nothing() -> None:
    queues = Queues()
    assert queues.take("q", at(0, 0)) is None
    assert queues.take("q", at(500, 10_000, 500, 10_000)) == carried(160e3, 0.5)
    assert queues.take("q", at(1000, 125_000, 500, 10_000)) == carried(1e6, 1.0)


def test_within_two_readings_more_a_queue_that_stands_is_believed() -> None:
    queues = Queues()
    for i in range(5):
        queues.take("q", at(500 * i, 62_500 * i))
    first = queues.take("q", at(2500, 260_000, 400, 12_500))
    second = queues.take("q", at(3000, 275_000, 900, 28_125))
    assert first is not None
    assert not first.filled
    assert second == Sample(250e3, filled=True, span_s=1.0)


def test_what_went_through_an_empty_queue_is_carried_at_least() -> None:
    queues = Queues()
    queues.take("q", at(1000, 50_000))
    assert queues.take("q", at(1500, 112_500)) == carried(1e6, 0.5)


def test_a_queue_that_stood_for_a_moment_did_not_fill_the_link() -> None:
    queues = Queues()
    for i in range(3):
        shown = queues.take("q", at(500 * i, 62_500 * i, i * (MIN_STOOD_MS - 1), 10 * i))
    assert shown == carried(1e6, 1.0)


def test_a_reading_that_was_lost_costs_nothing() -> None:
    queues = Queues()
    queues.take("q", at(0, 0))
    queues.take("q", at(500, 62_500, 200, 25_000))
    shown = queues.take("q", at(1500, 300_000, 900, 112_500))
    assert shown == Sample(1e6, filled=True, span_s=1.5)


@pytest.mark.parametrize(
    "again", [at(10, 0), at(3000, 400, 10, 10), at(3000, 900_000, 0, 0), at(10, 900_000, 700, 900)]
)
def test_counters_that_began_anew_show_nothing_until_they_were_read_again(again: Backlog) -> None:
    queues = Queues()
    queues.take("q", at(2000, 500_000, 600, 400_000))
    assert queues.take("q", again) is None
    for i in (1, 2):
        later = at(
            again.seen_ms + 500 * i,
            again.sent_bytes + 62_500 * i,
            again.stood_ms + 100 * i,
            again.stood_bytes + 12_500 * i,
        )
        shown = queues.take("q", later)
    assert shown == Sample(1e6, filled=True, span_s=1.0)


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
    for i in range(3):
        shown = queues.take("q", at(500 * i, 0, 500 * i, 0))
    assert shown is not None
    assert shown.filled
    assert shown.rate_bps > 0


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
