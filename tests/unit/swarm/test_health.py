"""What engines ask a process: whether it answers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from prometheus_client import CollectorRegistry

from swarm import health
from swarm.metrics import MetricsServer
from tests.support.free_ports import free_port
from tests.support.secure_swarm import made_keystore


def test_a_process_that_serves_metrics_is_well() -> None:
    server = MetricsServer(CollectorRegistry(), 0, "127.0.0.1")
    try:
        assert health.trouble(server.port) == ""
    finally:
        server.close()
    assert "does not answer" in health.trouble(server.port)


def test_the_program_says_by_its_status_that_nobody_answers() -> None:
    for port in (str(free_port()), "no-port"):
        done = subprocess.run(
            [sys.executable, "-m", "swarm.health", port],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode != 0
        assert done.stderr


def test_a_process_that_serves_metrics_over_tls_is_asked_over_tls(tmp_path: Path) -> None:
    store = made_keystore(tmp_path / "keystore", "s", "R1")
    server = MetricsServer(CollectorRegistry(), 0, "127.0.0.1", store.identity("R1"))
    try:
        assert health.trouble(server.port, tls=True) == ""
        assert health.trouble(server.port) != ""
    finally:
        server.close()
