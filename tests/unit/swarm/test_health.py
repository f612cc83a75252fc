"""What engines ask a process: whether it answers."""

from __future__ import annotations

import subprocess
import sys

from prometheus_client import CollectorRegistry

from swarm import health
from swarm.metrics import MetricsServer
from tests.support.free_ports import free_port


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
