"""The console's OpenAPI document against its answers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from swarm import keyspace
from swarm.errors import NetworkError
from swarm.messages import ShapeReply, ShapeRequest
from tests.support.console_swarm import Viewer, ask, console
from tests.support.described import check, check_answer
from tests.support.zenoh_fixtures import RouterProcess, SessionMaker, wait_until_served

TOKEN = "definitions-token"
RIGHT = {"Authorization": f"Bearer {TOKEN}"}
OFF = {"profile": "off"}


@pytest.fixture
def port(shared_router: RouterProcess, swarm_name: str, tmp_path: Path) -> Iterator[int]:
    (tmp_path / "run.mcap").write_bytes(b"recorded")
    values = {"console_token": TOKEN, "console_recordings": str(tmp_path)}
    with console(shared_router.address, swarm_name, **values) as port:
        yield port


@pytest.fixture
def document(port: int) -> dict[str, Any]:
    # Without the token: it says nothing of the swarm.
    found = ask(port, "GET", "/openapi.json")
    assert found.status == 200
    body: dict[str, Any] = json.loads(found.body)
    return body


def test_what_is_shown_follows_the_document(port: int, document: dict[str, Any]) -> None:
    for path, query, status in (
        ("/api/floor", "", 200),
        ("/api/recordings", "", 200),
        ("/api/history", "?span=900", 404),
        ("/api/history", "?span=1", 400),
        ("/api/history", "?span=900&ego=R9", 404),
        ("/api/events", "?ego=R9", 404),
    ):
        answer = ask(port, "GET", path + query, **RIGHT)
        assert answer.status == status
        check_answer(document, "GET", path, status, json.loads(answer.body))
    for path in ("/api/floor", "/api/recordings", "/api/history", "/api/events"):
        refused = ask(port, "GET", path)
        assert refused.status == 401
        check_answer(document, "GET", path, 401, json.loads(refused.body))
    refused = ask(port, "GET", "/api/floor", Host="elsewhere.example", **RIGHT)
    check_answer(document, "GET", "/api/floor", 421, json.loads(refused.body))
    recording = ask(port, "GET", "/recordings/run.mcap", **RIGHT)
    assert recording.body == b"recorded"
    described = document["paths"]["/recordings/{name}"]["get"]["responses"]
    assert recording.headers["content-type"] in described["200"]["content"]
    absent = ask(port, "GET", "/recordings/other.mcap", **RIGHT)
    check_answer(document, "GET", "/recordings/{name}", 404, json.loads(absent.body))


def test_events_follow_the_document(port: int, document: dict[str, Any]) -> None:
    answered = document["paths"]["/api/events"]["get"]["responses"]["200"]["content"]
    words = answered["text/event-stream"]["schema"]["properties"]["data"]
    with Viewer(port, **RIGHT) as viewer:
        for _ in range(2):
            check(document, viewer.next(), words["contentSchema"])


def test_controls_follow_the_document(
    port: int,
    document: dict[str, Any],
    shared_router: RouterProcess,
    open_session: SessionMaker,
    swarm_name: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def shape(request: ShapeRequest) -> ShapeReply:
        if request.robot:
            raise NetworkError(f"robot {request.robot!r} is not here")
        return ShapeReply(request=request.request, revision=1, shapes=())

    key = keyspace.net_shape(swarm_name)
    open_session(shared_router.address).serve(key, ShapeRequest, shape)
    wait_until_served(open_session(shared_router.address), key)
    with Viewer(port, **RIGHT) as viewer:
        viewer.until(lambda: viewer.state["swarm"]["connected"], "the swarm is there")
        mine = RIGHT | {
            "Origin": f"http://127.0.0.1:{port}",
            "X-CoAdapt-CSRF": viewer.csrf,
            "Content-Type": "application/json",
        }
        for body, status, headers in (
            (OFF, 200, {}),
            (OFF | {"robot": "R9"}, 409, {}),
            ({"profile": "sideways"}, 400, {}),
            ("x" * 1_500_001, 413, {}),
            (OFF, 403, {"X-CoAdapt-CSRF": "stolen"}),
            (OFF, 403, {"Origin": "http://elsewhere.example"}),
            (OFF, 415, {"Content-Type": "text/plain"}),
        ):
            answer = ask(port, "POST", "/api/shape", body, **(mine | headers))
            assert answer.status == status, answer.body
            check_answer(document, "POST", "/api/shape", status, json.loads(answer.body))
        monkeypatch.setattr("options.console.watch.ANSWER_S", 0.3)
        for what, path, asked in (
            ("ego", "/api/ego", {"wish": {}}),
            ("wish", "/api/wish", {"wish": "", "site": {}, "now": ""}),
            ("robot/R2", "/api/robot/{robot}", {"duty": "ask"}),
        ):
            answer = ask(port, "POST", f"/api/{what}", asked, **mine)
            assert answer.status == 504, answer.body
            check_answer(document, "POST", path, 504, json.loads(answer.body))
