"""The gateway's OpenAPI document against its answers: those to requests that schemathesis makes
from it, and those that chance would hardly ask for."""

from __future__ import annotations

import http.client
import json
from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from jsonschema import ValidationError

from llm_gateway.http_errors import of_gateway
from llm_gateway.model import Completion, Hear, Job
from swarm.errors import GatewayCode, GatewayError
from tests.support.definition_judge import RIGHT, TOKEN, hold, judge
from tests.support.described import check, check_answer
from tests.support.llm_endpoint import CHAT, HELLO, Client, Scripted, endpoint_of

WISHES = "/v1/wishes"
WISH = {
    "wish": "leave R3 alone and watch the docks until six",
    "site": {"robots": ["R1", "R3"], "places": ["docks"]},
    "now": "2027-01-15T12:00:00+01:00",
}
ROLES = json.dumps({"words": ["out", "high", "when", "all"]})


class Talking(Scripted):
    """Says what a test puts into `words`, in two pieces."""

    words = "Hello."

    async def complete(self, job: Job, hear: Hear | None = None) -> Completion:
        done = await super().complete(job)
        if hear is not None:
            hear(done.text[:3])
        return done

    async def echo(self, job: Job) -> Completion:
        done = await super().echo(job)
        return Completion(
            text=self.words,
            source=done.source,
            hit=done.hit,
            model=done.model,
            age_s=done.age_s,
            tokens=done.tokens,
            timings=done.timings,
        )


@pytest.fixture(scope="module")
def shared() -> Generator[tuple[Talking, Client]]:
    gateway = Talking()
    with endpoint_of(gateway, TOKEN) as client:
        yield gateway, client


@pytest.fixture
def gateway(shared: tuple[Talking, Client]) -> Talking:
    shared[0].reset()
    shared[0].words = "Hello."
    return shared[0]


@pytest.fixture
def endpoint(shared: tuple[Talking, Client], gateway: Talking) -> Client:
    return shared[1]


@pytest.fixture
def document(endpoint: Client) -> dict[str, Any]:
    # Without the token: it says nothing of the swarm.
    found = endpoint.send("GET", "/openapi.json")
    assert found.status == 200
    body: dict[str, Any] = found.body
    return body


def test_the_gateway_does_what_its_own_definition_says(endpoint: Client, tmp_path: Path) -> None:
    base = f"http://127.0.0.1:{endpoint.port}"
    hold(judge(f"{base}/openapi.json", base, tmp_path), 5)
    assert endpoint.count("coadapt_llm_http_requests_total", status="200") > 0
    assert endpoint.count("coadapt_llm_http_requests_total", status="500") == 0


def test_answers_follow_the_document(
    endpoint: Client, gateway: Talking, document: dict[str, Any]
) -> None:
    asked = endpoint.chat(headers=RIGHT)
    assert asked.text == "Hello."
    check_answer(document, "POST", CHAT, 200, asked.body)
    gateway.words = ROLES
    meant = endpoint.send("POST", WISHES, json.dumps(WISH).encode(), RIGHT)
    assert (meant.status, meant.body["exclude"]) == (200, ["R3"])
    check_answer(document, "POST", WISHES, 200, meant.body)
    for path, described in (
        ("/v1/models", "/v1/models"),
        ("/v1/models/test-model", "/v1/models/{name}"),
        ("/healthz", "/healthz"),
    ):
        found = endpoint.send("GET", path, None, RIGHT)
        assert found.status == 200
        check_answer(document, "GET", described, 200, found.body)


def test_a_schema_of_the_document_refuses_what_it_does_not_describe(
    endpoint: Client, document: dict[str, Any]
) -> None:
    answer = endpoint.chat(headers=RIGHT)
    for change in ({"usage": None}, {"choices": [{"index": 0}]}, {"object": "completion"}):
        with pytest.raises(ValidationError):
            check_answer(document, "POST", CHAT, 200, answer.body | change)


def test_events_follow_the_document(endpoint: Client, document: dict[str, Any]) -> None:
    body = {"messages": HELLO, "stream": True, "stream_options": {"include_usage": True}}
    with closing(http.client.HTTPConnection("127.0.0.1", endpoint.port, timeout=20)) as to:
        headers = RIGHT | {"Content-Type": "application/json"}
        to.request("POST", CHAT, json.dumps(body).encode(), headers)
        response = to.getresponse()
        assert response.status == 200
        said = response.read().decode()
    described = document["paths"][CHAT]["post"]["responses"]["200"]["content"]
    event = described["text/event-stream"]["schema"]
    last, words = event["properties"]["data"]["anyOf"]
    events = [line.removeprefix("data: ") for line in said.split("\n\n") if line]
    assert events.pop() == last["const"]
    # The head, two pieces, the end, the tokens.
    assert len(events) == 5
    for data in events:
        check(document, {"data": data}, event)
        check(document, json.loads(data), words["contentSchema"])
    late = json.loads(of_gateway(GatewayError("failed", "the model's process ended")).body())
    check(document, late, words["contentSchema"])


@pytest.mark.parametrize(
    ("code", "status"),
    [("expired", 504), ("busy", 429), ("too_large", 413), ("unavailable", 503), ("failed", 502)],
)
@pytest.mark.parametrize("path", [CHAT, WISHES])
def test_refusals_of_the_gateway_follow_the_document(
    endpoint: Client,
    gateway: Talking,
    document: dict[str, Any],
    path: str,
    code: GatewayCode,
    status: int,
) -> None:
    async def refuse(job: Job) -> Completion:
        raise GatewayError(code, "why")

    gateway.answer = refuse
    body = WISH if path == WISHES else {"messages": HELLO}
    refused = endpoint.send("POST", path, json.dumps(body).encode(), RIGHT)
    assert refused.status == status
    check_answer(document, "POST", path, refused.status, refused.body)


def test_refusals_of_requests_follow_the_document(
    endpoint: Client, document: dict[str, Any]
) -> None:
    statuses = set()
    for path in (CHAT, WISHES):
        for raw, headers in (
            (b"{}", RIGHT),
            (b"{}", {}),
            (b"{}", RIGHT | {"Host": "elsewhere.example"}),
            (b"{}", RIGHT | {"Content-Type": "text/plain"}),
            (b" " * 2_000_001, RIGHT),
        ):
            refused = endpoint.send("POST", path, raw, headers)
            statuses.add(refused.status)
            check_answer(document, "POST", path, refused.status, refused.body)
    assert statuses == {400, 401, 403, 413, 415}
    absent = endpoint.send("GET", "/v1/models/other", None, RIGHT)
    assert absent.status == 404
    check_answer(document, "GET", "/v1/models/{name}", 404, absent.body)


@pytest.mark.parametrize("now", ["noon", "2027-01-15T12:00:00", ""])
def test_a_wish_without_a_time_is_the_clients_mistake(endpoint: Client, now: str) -> None:
    body = json.dumps(WISH | {"now": now}).encode()
    refused = endpoint.send("POST", WISHES, body, RIGHT)
    assert (refused.status, refused.error["param"]) == (400, "now")
