"""What Prometheus reads of the console."""

from __future__ import annotations

import math
import time

from prometheus_client import CollectorRegistry, Counter, Gauge

from options.console.controls import CONTROLS
from options.console.seats import Seats
from swarm.metrics import start_at_zero


class ConsoleMetrics:
    """Labels are bounded: three kinds of requests, and how they ended."""

    def __init__(self, registry: CollectorRegistry) -> None:
        self._registry = registry
        self.events = Counter(
            "coadapt_console_events_total", "Events sent to viewers.", registry=registry
        )
        self.sent = Counter(
            "coadapt_console_sent_bytes_total", "Bytes of these events.", registry=registry
        )
        self.stalled = Counter(
            "coadapt_console_stalled_total", "Viewers let go who took nothing.", registry=registry
        )
        self.requests = Counter(
            "coadapt_console_requests_total",
            "Requests of operators: done, refused, or unanswered.",
            ["what", "outcome"],
            registry=registry,
        )
        start_at_zero(self.requests, CONTROLS, ("done", "refused", "unanswered"))

    def show(self, seats: Seats) -> None:
        """Adds what is looked up whenever somebody asks."""
        view = seats.first.view

        def gauge(name: str, text: str) -> Gauge:
            return Gauge(f"coadapt_console_{name}", text, registry=self._registry)

        gauge("viewers", "Pages that are open.").set_function(lambda: seats.viewers)
        gauge("connected", "1 while the swarm's router is reached.").set_function(
            lambda: view.connected
        )
        gauge(
            "decision_age_seconds", "Since a decision of the first ego came; NaN before the first."
        ).set_function(
            lambda: math.nan if view.decided_at is None else time.monotonic() - view.decided_at
        )
