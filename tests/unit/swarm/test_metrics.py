"""Metrics are served to a real scraper, and a taken port is told clearly."""

from __future__ import annotations

import math
import re
import time
import urllib.request
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry, Counter

from swarm.errors import IdentityError, SettingError
from swarm.metrics import MetricsServer, serve_metrics, show_free_disk
from swarm.process import SwarmSettings
from swarm.settings import load
from swarm.trust.identity import Identity


def scrape(port: int) -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as response:
        return response.read().decode()


def test_counts_can_be_scraped_and_the_port_is_free_afterwards() -> None:
    registry = CollectorRegistry()
    Counter("coadapt_example", "An example.", registry=registry).inc(3)
    server = MetricsServer(registry, 0, "127.0.0.1")
    try:
        text = scrape(server.port)
        assert "coadapt_example_total 3.0" in text
        # By which Prometheus sees that a process has been started again.
        (begun,) = re.findall(r"^process_start_time_seconds (\S+)$", text, re.MULTILINE)
        assert 0 < time.time() - float(begun) < 1e6
    finally:
        server.close()
    MetricsServer(registry, server.port, "127.0.0.1").close()


def test_a_port_in_use_is_refused_with_the_variable_to_change() -> None:
    server = MetricsServer(CollectorRegistry(), 0, "127.0.0.1")
    try:
        with pytest.raises(SettingError, match=rf"port {server.port} .*COADAPT_METRICS_PORT"):
            MetricsServer(CollectorRegistry(), server.port, "127.0.0.1")
    finally:
        server.close()


def test_registries_do_not_share_counts() -> None:
    first, second = CollectorRegistry(), CollectorRegistry()
    Counter("coadapt_example", "An example.", registry=first).inc()
    Counter("coadapt_example", "An example.", registry=second)
    assert second.get_sample_value("coadapt_example_total") == 0.0


def test_room_on_a_disk_is_told_and_where_nobody_knows_that_it_is_not_known(tmp_path: Path) -> None:
    here, nowhere = CollectorRegistry(), CollectorRegistry()
    show_free_disk(here, tmp_path / "journal")
    show_free_disk(nowhere, tmp_path / "away" / "journal")
    free = here.get_sample_value("coadapt_disk_free_bytes")
    assert free is not None
    assert free > 0
    assert math.isnan(nowhere.get_sample_value("coadapt_disk_free_bytes") or 0.0)


def test_tls_needs_a_certificate() -> None:
    settings = load(SwarmSettings, {"COADAPT_METRICS_TLS": "true", "COADAPT_METRICS_PORT": "0"})
    with pytest.raises(SettingError, match="COADAPT_METRICS_TLS = true needs a certificate"):
        serve_metrics(CollectorRegistry(), settings)


def test_a_certificate_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(IdentityError, match=r"R7/cert.pem .*coadapt certs issue R7"):
        MetricsServer(CollectorRegistry(), 0, "127.0.0.1", Identity(tmp_path / "R7"))
