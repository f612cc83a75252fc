"""The meter of a queue adds up for how long it stood, and what left it then."""

from __future__ import annotations

from swarm.backlog import BacklogMeter
from swarm.messages import Backlog


def fed(*samples: tuple[float, int, float]) -> Backlog:
    meter = BacklogMeter()
    for at_s, counter, stood_s in samples:
        meter.add(at_s, counter, stood_s)
    return meter.read()


def test_before_any_sample_all_counters_are_zero() -> None:
    assert BacklogMeter().read() == Backlog()


def test_what_left_before_the_first_sample_does_not_count() -> None:
    assert fed((5.0, 10_000, 3.0)) == Backlog()


def test_what_left_while_the_queue_stood_is_told_apart() -> None:
    found = fed((5.0, 100, 0.0), (5.02, 200, 0.0), (5.04, 300, 0.01), (5.06, 900, 0.0))
    assert found == Backlog(seen_ms=60, sent_bytes=800, stood_ms=10, stood_bytes=100)


def test_a_counter_that_begins_anew_is_another_queue() -> None:
    found = fed((0.0, 9000, 0.0), (0.02, 10_000, 0.02), (0.04, 5, 0.02), (0.06, 1005, 0.02))
    assert found == Backlog(seen_ms=60, sent_bytes=2000, stood_ms=40, stood_bytes=2000)
