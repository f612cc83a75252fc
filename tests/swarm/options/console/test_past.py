"""What the console passes on from Prometheus and of recordings, and what it says without."""

from __future__ import annotations

import http.client
import itertools
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry

from ego_agent.metrics import EgoMetrics
from options.console.past import STEPS_S
from swarm.metrics import MetricsServer
from tests.support.console_swarm import EGO, WAIT_S, Viewer, ask, console
from tests.support.free_ports import free_port
from tests.support.zenoh_fixtures import RouterProcess, until

SCRAPE_S = 1
ALERTING = {
    "groups": [
        {
            "name": "always",
            "rules": [
                {
                    "alert": "Always",
                    "expr": "vector(1)",
                    "labels": {"severity": "warning"},
                    "annotations": {"summary": "It fires.", "description": "Nothing is to do."},
                }
            ],
        }
    ]
}


@pytest.fixture(scope="module")
def prometheus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real one that reads an ego's metrics, which say that 5 Mbit/s are there."""
    if shutil.which("prometheus") is None:
        pytest.skip("no prometheus: install Debian's package prometheus")
    registry = CollectorRegistry()
    metrics = EgoMetrics(registry)
    metrics.capacity_bps.set(5e6)
    metrics.participants.set(3)
    folder = tmp_path_factory.mktemp("prometheus")
    ego = MetricsServer(registry, 0, "127.0.0.1")
    (folder / "rules.yml").write_text(json.dumps(ALERTING))
    (folder / "prometheus.yml").write_text(
        json.dumps(
            {
                "global": {
                    "scrape_interval": f"{SCRAPE_S}s",
                    "scrape_timeout": f"{SCRAPE_S}s",
                    "evaluation_interval": "1s",
                },
                "rule_files": ["rules.yml"],
                "scrape_configs": [
                    {
                        "job_name": "ego",
                        "static_configs": [
                            {
                                "targets": [f"127.0.0.1:{ego.port}"],
                                "labels": {"instance": f"ego-{EGO}"},
                            }
                        ],
                    }
                ],
            }
        )
    )
    port = free_port()
    process = subprocess.Popen(
        [
            "prometheus",
            f"--config.file={folder}/prometheus.yml",
            f"--storage.tsdb.path={folder}/data",
            f"--web.listen-address=127.0.0.1:{port}",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait(20)
        ego.close()


def test_history_comes_from_prometheus_with_what_was_not_heard_as_null(
    prometheus: str, shared_router: RouterProcess, swarm_name: str
) -> None:
    with console(shared_router.address, swarm_name, console_prometheus=prometheus) as port:

        def told() -> bool:
            answer = ask(port, "GET", "/api/history?span=120")
            return answer.status == 200 and len(json.loads(answer.body)["rows"]) > 1

        until(told, "two steps are told")
        rows = json.loads(ask(port, "GET", "/api/history?span=120").body)["rows"]
    assert all(later["at"] - row["at"] == STEPS_S[120] for row, later in itertools.pairwise(rows))
    assert rows[-1]["capacity_bps"] == 5e6
    assert rows[-1]["robots"] == 3
    assert (rows[-1]["latency_ms"], rows[-1]["algorithm"]) == (None, None)


def test_alerts_of_prometheus_are_put_before_a_viewer(
    prometheus: str, shared_router: RouterProcess, swarm_name: str
) -> None:
    with (
        console(shared_router.address, swarm_name, console_prometheus=prometheus) as port,
        Viewer(port) as viewer,
    ):
        viewer.until(lambda: bool(viewer.state.get("alerts", {}).get("firing")), "an alert")
        (alert,) = viewer.state["alerts"]["firing"]
    assert (alert["name"], alert["severity"]) == ("Always", "warning")
    assert (alert["summary"], alert["description"]) == ("It fires.", "Nothing is to do.")


def test_a_prometheus_that_does_not_answer_is_named(
    shared_router: RouterProcess, swarm_name: str
) -> None:
    url = f"http://127.0.0.1:{free_port()}"
    with (
        console(shared_router.address, swarm_name, console_prometheus=url) as port,
        Viewer(port) as viewer,
    ):
        answer = ask(port, "GET", "/api/history?span=900")
        assert answer.status == 503
        assert f"Prometheus at {url} does not answer" in answer.error
        viewer.until(lambda: bool(viewer.state.get("alerts", {}).get("error")), "a reason")
        assert viewer.state["alerts"]["firing"] == []


def test_without_prometheus_and_recordings_the_console_says_so(
    shared_router: RouterProcess, swarm_name: str
) -> None:
    with console(shared_router.address, swarm_name) as port:
        answer = ask(port, "GET", "/api/history?span=120")
        assert (answer.status, answer.error) == (404, "the swarm runs without Prometheus")
        for span in ("", "121", "-1", "²", "1e3"):
            answer = ask(port, "GET", f"/api/history?span={span.replace('²', '%C2%B2')}")
            assert answer.status == 400
            assert "120, 900, 3600, 21600 s" in answer.error
        assert ask(port, "GET", "/api/recordings").body == b"[]"
        assert ask(port, "GET", "/recordings/x.mcap").status == 404


def test_recordings_are_listed_newest_first_and_nothing_else_is_given_away(
    shared_router: RouterProcess, swarm_name: str, tmp_path: Path
) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    (tmp_path / "secret.mcap").write_bytes(b"secret")
    (folder / "notes.txt").write_bytes(b"notes")
    for age_s, name in ((10, "old.mcap"), (0, "new.mcap")):
        (folder / name).write_bytes(name.encode())
        at = time.time() - age_s
        os.utime(folder / name, (at, at))
    with console(shared_router.address, swarm_name, console_recordings=str(folder)) as port:
        found = json.loads(ask(port, "GET", "/api/recordings").body)
        assert [(one["name"], one["bytes"]) for one in found] == [("new.mcap", 8), ("old.mcap", 8)]
        assert ask(port, "GET", "/recordings/new.mcap").body == b"new.mcap"
        for name in ("notes.txt", "..%2fsecret.mcap", "../secret.mcap", "%2e%2e"):
            assert ask(port, "GET", f"/recordings/{name}").status == 404


def test_a_recording_that_grows_is_given_as_it_was_when_it_was_asked_for(
    shared_router: RouterProcess, swarm_name: str, tmp_path: Path
) -> None:
    file = tmp_path / "growing.mcap"
    begun = os.urandom(4_000_000)
    file.write_bytes(begun)
    with console(shared_router.address, swarm_name, console_recordings=str(tmp_path)) as port:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=WAIT_S)
        with closing(connection):
            connection.request("GET", "/recordings/growing.mcap")
            reply = connection.getresponse()
            first = reply.read(1000)
            with file.open("ab") as more:
                more.write(bytes(1_000_000))
            assert first + reply.read() == begun
        assert len(ask(port, "GET", "/recordings/growing.mcap").body) == 5_000_000
