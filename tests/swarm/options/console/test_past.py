"""What the console passes on from Prometheus and of recordings, and what it says without."""

from __future__ import annotations

import asyncio
import http.client
import itertools
import json
import os
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from prometheus_client import CollectorRegistry
from starlette.exceptions import HTTPException

from ego_agent.metrics import EgoMetrics
from options.console.files import MAX_SHOWN, Recordings
from options.console.past import STEPS_S
from options.console.settings import load_settings
from swarm.errors import SettingError
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


@contextmanager
def other_server(body: bytes, url: str = "http://127.0.0.1:0") -> Iterator[tuple[str, list[str]]]:
    """A server that answers everything with this body; its URL, and the paths it was asked for."""
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path.partition("?")[0])
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", urlsplit(url).port or 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", asked
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


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


def test_history_is_asked_for_again_as_soon_as_prometheus_is_back(
    shared_router: RouterProcess, swarm_name: str
) -> None:
    url = f"http://127.0.0.1:{free_port()}"
    with console(shared_router.address, swarm_name, console_prometheus=url) as port:
        # The longest span, whose answers are kept for a minute.
        assert ask(port, "GET", "/api/history?span=21600").status == 503
        with other_server(b'{"data": {"result": []}}', url):
            assert json.loads(ask(port, "GET", "/api/history?span=21600").body) == {"rows": []}


@pytest.mark.parametrize(
    "body",
    [
        b"<html>",
        b"[]",
        b"{}",
        b'{"data": null}',
        b'{"data": {"alerts": 1, "result": 1}}',
        b'{"data": {"alerts": [{"state": "firing"}], "result": [{"metric": {}}]}}',
        b'{"data": {"alerts": [[]], "result": [{"metric": {}, "values": [[1, "soon"]]}]}}',
    ],
)
def test_another_server_than_prometheus_is_named_and_asked_again(
    shared_router: RouterProcess, swarm_name: str, monkeypatch: pytest.MonkeyPatch, body: bytes
) -> None:
    monkeypatch.setattr("options.console.alerts.PERIOD_S", 0.1)
    with (
        other_server(body) as (url, asked),
        console(shared_router.address, swarm_name, console_prometheus=url) as port,
        Viewer(port) as viewer,
    ):
        answer = ask(port, "GET", "/api/history?span=120")
        assert answer.status == 503
        assert f"{url} does not answer as Prometheus does" in answer.error
        viewer.until(lambda: bool(viewer.state.get("alerts", {}).get("error")), "a reason")
        until(lambda: asked.count("/api/v1/alerts") > 1, "it is asked again")


@pytest.mark.parametrize(
    "url",
    [
        "https://127.0.0.1:9090",
        "http://ada:secret@127.0.0.1:9090",
        "http://127.0.0.1:9090/path",
        "http://127.0.0.1:9090?a=b",
        "http://",
        "ftp://127.0.0.1",
    ],
)
def test_prometheus_is_asked_at_a_plain_address_only(url: str) -> None:
    with pytest.raises(SettingError, match=r"must be http://host\[:port\], without TLS") as refused:
        load_settings({"COADAPT_EGO": "R1", "COADAPT_CONSOLE_PROMETHEUS": url})
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize("url", ["", "http://prometheus", "http://10.0.0.1:9090", "http://[::1]:9"])
def test_such_an_address_is_taken(url: str) -> None:
    values = {"COADAPT_EGO": "R1", "COADAPT_CONSOLE_PROMETHEUS": url}
    assert load_settings(values).console_prometheus == url


def test_browsers_may_reach_prometheus_by_tls_but_their_link_names_no_user() -> None:
    variable = "COADAPT_CONSOLE_PROMETHEUS_LINK"
    link = "https://prometheus.plant"
    settings = load_settings({"COADAPT_EGO": "R1", variable: link})
    assert settings.console_prometheus_link == link
    with pytest.raises(SettingError, match=variable):
        load_settings({"COADAPT_EGO": "R1", variable: "https://ada:secret@prometheus.plant"})


def test_without_prometheus_and_recordings_the_console_says_so(
    shared_router: RouterProcess, swarm_name: str
) -> None:
    with console(shared_router.address, swarm_name) as port:
        answer = ask(port, "GET", "/api/history?span=120")
        assert (answer.status, answer.error) == (404, "the swarm runs without Prometheus")
        for span in ("", "121", "-1", "0120", "²", "1e3", "1" * 5000):
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


def test_older_recordings_than_are_listed_can_be_had(tmp_path: Path) -> None:
    for number in range(MAX_SHOWN + 1):
        path = tmp_path / f"{number}.mcap"
        path.write_bytes(b"recorded")
        os.utime(path, (number, number))
    recordings = Recordings(str(tmp_path))
    assert "0.mcap" not in {one.name for one in recordings.found()}
    assert taken(recordings, "0.mcap") == (200, b"recorded")


def test_a_recording_that_is_deleted_once_it_is_asked_for_is_still_given(tmp_path: Path) -> None:
    (tmp_path / "short.mcap").write_bytes(b"recorded")
    recordings = Recordings(str(tmp_path))
    assert taken(recordings, "short.mcap", (tmp_path / "short.mcap").unlink) == (200, b"recorded")
    with pytest.raises(HTTPException) as refused:
        recordings.file("short.mcap")
    assert refused.value.status_code == 404


def test_what_is_no_file_is_neither_listed_nor_given(tmp_path: Path) -> None:
    (tmp_path / "folder.mcap").mkdir()
    os.mkfifo(tmp_path / "pipe.mcap")
    (tmp_path / "nowhere.mcap").symlink_to(tmp_path / "gone")
    recordings = Recordings(str(tmp_path))
    assert recordings.found() == []
    for name in ("folder.mcap", "pipe.mcap", "nowhere.mcap"):
        with pytest.raises(HTTPException) as refused:
            recordings.file(name)
        assert refused.value.status_code == 404


def taken(
    recordings: Recordings, name: str, meanwhile: Callable[[], None] = lambda: None
) -> tuple[int, bytes]:
    """Status and body of a download; `meanwhile` is done before anything is sent."""
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        await asyncio.Event().wait()

    response = recordings.file(name)
    meanwhile()
    asyncio.run(response({"type": "http", "method": "GET"}, receive, send))
    body = b"".join(message.get("body", b"") for message in sent)
    assert dict(sent[0]["headers"])[b"content-length"] == str(len(body)).encode()
    return sent[0]["status"], body


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
