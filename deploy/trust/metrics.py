"""What Prometheus learns of certificates."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Gauge


class AuthorityMetrics:
    """The gauges of a swarm's authority."""

    def __init__(self, registry: CollectorRegistry, life_s: float) -> None:
        """`life_s`: how long new certificates hold."""
        life = Gauge(
            "coadapt_certificate_life_seconds",
            "How long a new certificate holds.",
            registry=registry,
        )
        life.set(life_s)
        self.left = Gauge(
            "coadapt_certificate_seconds",
            "How long a certificate still holds.",
            ["name"],
            registry=registry,
        )
