"""What Prometheus reads of the API."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge

from network_controller.qod.profiles import LEVELS
from swarm.metrics import start_at_zero

_METHODS = frozenset({"GET", "POST", "DELETE"})


class QodMetrics:
    """Labels are bounded: four profiles, three methods, five classes of status."""

    def __init__(self, registry: CollectorRegistry) -> None:
        self.sessions = Gauge(
            "coadapt_qod_sessions", "Sessions in force.", ["profile"], registry=registry
        )
        self.events = Counter(
            "coadapt_qod_events_total",
            "Events to sinks, by what became of them.",
            ["outcome"],
            registry=registry,
        )
        self._requests = Counter(
            "coadapt_qod_requests_total",
            "Requests, by method and class of status.",
            ["method", "status"],
            registry=registry,
        )
        for name in LEVELS:
            self.sessions.labels(name).set(0)
        outcomes = ("delivered", "refused", "forbidden", "failed", "expired", "dropped")
        start_at_zero(self.events, outcomes)
        start_at_zero(self._requests, (*_METHODS, "other"), ("2xx", "4xx", "5xx"))

    def request(self, method: str, status: int) -> None:
        """Counts an answer."""
        known = method if method in _METHODS else "other"
        self._requests.labels(known, f"{status // 100}xx").inc()
