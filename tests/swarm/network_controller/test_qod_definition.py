"""The API against definitions: schemathesis makes requests from one and judges the answers by it.

The definition that the API serves itself is always at hand. CAMARA's own is third-party data: take
release r3.2 of github.com/camaraproject/QualityOnDemand, and name its `code/API_definitions` in
$QOD_OPENAPI.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.definition_judge import RIGHT, TOKEN, hold, judge
from tests.support.first_hour import Figure
from tests.support.qod_client import (
    LOOPBACK,
    PROFILES,
    RETRIEVE,
    RETRIEVE_PROFILES,
    SESSIONS,
    Api,
    device,
    served,
    wish,
)

HOOKS = "tests.support.qod_hooks"
SESSION = f"{SESSIONS}/00000000-0000-4000-8000-000000000001"


@pytest.fixture
def api() -> Iterator[Api]:
    with served(token=TOKEN, sinks=LOOPBACK) as api:
        yield api


@pytest.mark.slow
@pytest.mark.stumble(
    "Quality on Demand does not do what its OpenAPI file says",
    command="schemathesis --config-file tests/support/schemathesis.toml run "
    "http://127.0.0.1:9104/openapi.json",
)
def test_the_api_does_what_its_own_definition_says(
    api: Api, tmp_path: Path, figure: Figure
) -> None:
    base = f"http://127.0.0.1:{api.server.port}"
    found = judge(f"{base}/openapi.json", base, tmp_path, HOOKS)
    figure("schemathesis_failures", len(found["failures"]) + len(found["errors"]))
    hold(found, 9)
    for method in ("POST", "GET", "DELETE"):
        assert api.count("coadapt_qod_requests_total", method=method, status="2xx") > 0
        assert api.count("coadapt_qod_requests_total", method=method, status="5xx") == 0


@pytest.mark.peer
@pytest.mark.parametrize(
    ("name", "base", "operations"),
    [
        ("quality-on-demand", SESSIONS.rpartition("/")[0], 5),
        ("qos-profiles", "/qos-profiles/v1", 2),
    ],
)
def test_the_api_does_what_camaras_definition_says(
    api: Api, tmp_path: Path, figure: Figure, name: str, base: str, operations: int
) -> None:
    folder = os.environ.get("QOD_OPENAPI", "")
    if not folder:
        pytest.skip("CAMARA's definitions are not here: name their folder in $QOD_OPENAPI")
    url = f"http://127.0.0.1:{api.server.port}{base}"
    found = judge(str(Path(folder) / f"{name}.yaml"), url, tmp_path, HOOKS)
    figure(f"schemathesis_failures_{name}", len(found["failures"]) + len(found["errors"]))
    hold(found, operations)


def strangers(body: Any) -> Any:
    """A body with a field that nobody knows in each of its objects."""
    if isinstance(body, dict):
        return {name: strangers(value) for name, value in body.items()} | {"x-new": {"a": [1]}}
    return [strangers(item) for item in body] if isinstance(body, list) else body


@pytest.mark.stumble(
    "Quality on Demand refuses fields that CAMARA's schema allows",
    command="""curl $API/sessions -H 'Content-Type: application/json' -d '{..., "x-new": 1}'""",
)
def test_unknown_fields_change_nothing(api: Api) -> None:
    bodies = {
        SESSIONS: wish(
            devicePorts={"ports": [1], "ranges": [{"from": 1, "to": 2}]},
            sink="https://127.0.0.1:9/events",
            sinkCredential={
                "credentialType": "ACCESSTOKEN",
                "accessToken": "opaque",
                "accessTokenExpiresUtc": "2999-01-01T00:00:00Z",
                "accessTokenType": "bearer",
            },
        ),
        RETRIEVE: {"device": device("10.77.0.2")},
        RETRIEVE_PROFILES: {"device": device("10.77.0.2"), "status": "ACTIVE"},
    }
    for path, body in bodies.items():
        reply = api.send("POST", path, strangers(body), headers=RIGHT)
        assert reply.status in (200, 201), reply.body
        assert "x-new" not in json.dumps(reply.body)
    created = api.send("POST", RETRIEVE, bodies[RETRIEVE], headers=RIGHT).body[0]
    more = strangers({"requestedAdditionalDuration": 60})
    path = f"{SESSIONS}/{created['sessionId']}/extend"
    assert api.send("POST", path, more, headers=RIGHT).body["duration"] == 120


@pytest.mark.stumble(
    "a method that Quality on Demand lacks is answered with half of those that it has",
    command="curl -i -X PUT $API/sessions/$SESSION",
)
@pytest.mark.parametrize(
    ("path", "allowed"),
    [
        (SESSION, {"GET", "HEAD", "DELETE"}),
        (SESSIONS, {"POST"}),
        (f"{SESSION}/extend", {"POST"}),
        (PROFILES, {"GET", "HEAD"}),
    ],
)
def test_a_path_tells_all_its_methods(api: Api, path: str, allowed: set[str]) -> None:
    for method in ("PUT", "OPTIONS"):
        reply = api.send(method, path, headers=RIGHT)
        assert (reply.status, reply.body["code"]) == (405, "METHOD_NOT_ALLOWED")
        assert set(reply.headers["allow"].split(", ")) == allowed


@pytest.mark.stumble(
    "a body without a type is refused with a status that the definition does not know",
    command="curl -X POST $API/sessions",
)
def test_no_body_is_an_invalid_one_and_another_type_is_unsupported(api: Api) -> None:
    document = api.send("GET", "/openapi.json").body
    for path in (SESSIONS, RETRIEVE, RETRIEVE_PROFILES):
        assert "415" in document["paths"][path]["post"]["responses"]
        missing = api.send("POST", path, headers=RIGHT)
        assert (missing.status, missing.body["code"]) == (400, "INVALID_ARGUMENT")
        assert missing.body["message"] == "the body is missing"
        for kind in ("text/plain", "application/jsonp", "multipart/form-data; boundary=x", ""):
            reply = api.send("POST", path, raw=b"{}", headers=RIGHT | {"Content-Type": kind})
            assert (reply.status, reply.body["code"]) == (415, "UNSUPPORTED_MEDIA_TYPE")
        taken = api.send(
            "POST", path, raw=b"{}", headers=RIGHT | {"Content-Type": "Application/JSON; a=b"}
        )
        assert taken.status != 415
