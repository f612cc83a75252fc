"""The meter of a queue counts the time in which it stood for sure, and what left it then."""

from __future__ import annotations

from swarm.backlog import MAX_GAP_S, BacklogMeter, QueueSample
from swarm.messages import Backlog


def fed(*samples: tuple[float, bool, int]) -> Backlog:
    meter = BacklogMeter()
    for at_s, waiting, sent in samples:
        meter.add(QueueSample(at_s, waiting, sent))
    return meter.read()


def test_before_any_sample_all_counters_are_zero() -> None:
    assert BacklogMeter().read() == Backlog()


def test_time_counts_where_the_queue_stood_at_both_ends() -> None:
    found = fed((5.0, False, 100), (5.02, True, 200), (5.04, True, 300), (5.06, False, 900))
    assert found == Backlog(seen_ms=60, sent_bytes=800, stood_ms=20, stood_bytes=100)


def test_a_queue_that_is_empty_now_and_then_did_not_stand() -> None:
    found = fed(*((i * 0.02, i % 2 == 0, i * 1000) for i in range(50)))
    assert (found.stood_ms, found.stood_bytes, found.sent_bytes) == (0, 0, 49_000)


def test_samples_that_came_late_prove_nothing_of_the_time_between() -> None:
    gap_s = 2 * MAX_GAP_S
    found = fed(*((i * gap_s, True, i * 1000) for i in range(10)))
    assert (found.stood_ms, found.sent_bytes) == (0, 9000)


def test_what_else_is_known_of_the_time_between_counts() -> None:
    meter = BacklogMeter()
    meter.add(QueueSample(0.0, True, 0))
    meter.add(QueueSample(0.02, True, 1000), between=False)
    meter.add(QueueSample(0.04, True, 2000))
    assert meter.read() == Backlog(seen_ms=40, sent_bytes=2000, stood_ms=20, stood_bytes=1000)


def test_a_counter_that_begins_anew_is_another_queue() -> None:
    found = fed((0.0, True, 9000), (0.02, True, 10_000), (0.04, True, 5), (0.06, True, 1005))
    assert found == Backlog(seen_ms=60, sent_bytes=2000, stood_ms=40, stood_bytes=2000)
