"""Prometheus metrics over HTTP, on a registry of their own so that tests do not share counts."""

from __future__ import annotations

import math
import os
import shutil
import socket
import threading
from collections.abc import Iterable
from itertools import product
from pathlib import Path

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector

from swarm.errors import SettingError
from swarm.http.metrics_server import MetricsHttpServer
from swarm.process import SwarmSettings
from swarm.trust.identity import Identity
from swarm.zenoh_config import identity_of

HOST = "COADAPT_HOST"
"""Names the host in metrics, where its own name says nothing, as in a container."""


def start_at_zero(metric: Counter | Histogram, *values: Iterable[str]) -> None:
    """Shows a metric at 0 for every combination of values, given in the order of its labels.

    A series that comes into being with its first count is missing until then, and Prometheus'
    `rate` never sees that count.
    """
    for labels in product(*values):
        metric.labels(*labels)


def show_free_disk(registry: CollectorRegistry, path: Path) -> None:
    """Shows how much room is left where a file lies or will lie; NaN where nobody can tell."""

    def free() -> float:
        try:
            return shutil.disk_usage(path.parent).free
        except OSError:
            return math.nan

    gauge = Gauge(
        "coadapt_disk_free_bytes", "Room on the disk of the process's journal.", registry=registry
    )
    gauge.set_function(free)


def serve_metrics(registry: CollectorRegistry, settings: SwarmSettings) -> MetricsServer:
    """Serves a process's metrics as its settings say. Raises what `MetricsServer` raises, and
    SettingError for TLS in a plain swarm, where nobody has a certificate."""
    identity = identity_of(settings.router) if settings.metrics_tls else None
    if settings.metrics_tls and identity is None:
        raise SettingError(
            "COADAPT_METRICS_TLS = true needs a certificate, and the router "
            f"{settings.router!r} is asked without one; use tls/HOST:PORT#identity=FOLDER"
        )
    return MetricsServer(registry, settings.metrics_port, settings.metrics_host, identity)


class MetricsServer:
    """Serves one registry at http://host:port/metrics until closed. Port 0 takes a free one.

    What the process itself takes is served, too: `process_start_time_seconds` and its like.

    With an identity it is served over TLS, and as https.

    Raises SettingError when the port cannot be bound, and IdentityError for a certificate that
    cannot be shown.
    """

    def __init__(
        self,
        registry: CollectorRegistry,
        port: int,
        host: str = "0.0.0.0",
        identity: Identity | None = None,
    ) -> None:
        try:
            self._server = MetricsHttpServer(registry, host, port, identity)
        except OSError as error:
            raise SettingError(
                f"metrics port {port} on {host} cannot be bound: {error}; choose a free one with "
                "COADAPT_METRICS_PORT (0 takes any)"
            ) from error
        self._registry = registry
        self._process = ProcessCollector(registry=registry)
        self._host = Gauge(
            "coadapt_process_host",
            "1: the host that the process runs on.",
            ["host"],
            registry=None,
        )
        self._host.labels(os.environ.get(HOST, "") or socket.gethostname()).set(1)
        registry.register(self._host)
        self._thread = threading.Thread(
            target=self._server.serve_forever, name="metrics", daemon=True
        )
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that is bound."""
        return int(self._server.server_address[1])

    def close(self) -> None:
        """Stops serving and frees the port."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
        self._registry.unregister(self._process)
        self._registry.unregister(self._host)
