"""The whole way from an HTTP client to a model server that misbehaves, and back."""

from __future__ import annotations

import http.client
import json
from contextlib import closing
from typing import Any

import pytest

from tests.support.free_ports import free_port
from tests.support.llm_endpoint import CHAT, HELLO, Answer, Client, gateway_of
from tests.support.model_server import (
    Behaviour,
    ModelServer,
    breaks_off,
    completion,
    drips,
    floods,
    hangs,
    refuses,
    resets,
    says,
    serving_model,
    status,
)
from tests.support.zenoh_fixtures import until

# What an ego asks for: robots that are there, and algorithms that fit the link.
SCHEMA = {
    "type": "object",
    "properties": {
        "participants": {"type": "array", "items": {"enum": ["R1", "R2"]}, "minItems": 1},
        "algorithm": {"enum": ["late"]},
    },
    "required": ["participants", "algorithm"],
    "additionalProperties": False,
}
GOOD = '{"participants":["R1"],"algorithm":"late"}'
CALLS = "coadapt_llm_model_calls_total"


def decide(client: Client, deadline_s: float = 20, **fields: Any) -> Answer:
    asked = {"type": "json_schema", "json_schema": {"name": "decision", "schema": SCHEMA}}
    headers = {"X-CoAdapt-Deadline": str(deadline_s)}
    return client.chat(headers=headers, response_format=asked, **fields)


def ask(number: int) -> dict[str, Any]:
    """Fields that make a prompt of its own."""
    return {"messages": [{"role": "user", "content": f"Scene {number}."}]}


@pytest.mark.parametrize(
    ("behaviour", "expected", "code"),
    [
        (status(429, "slow down", Retry_After="3"), 503, "unavailable"),
        (refuses(503, "loading"), 503, "unavailable"),
        (resets(), 503, "unavailable"),
        (refuses(500, "boom"), 502, "failed"),
        (status(200, json.dumps(completion(GOOD))[:-20]), 502, "failed"),
        (breaks_off(b"HTTP/1.1 200 OK\r\nContent-Length: 500\r\n\r\n{"), 502, "failed"),
        (floods(5_000_000), 502, "failed"),
        (says(None), 502, "failed"),
        (refuses(400, "maximum context length is 512 tokens"), 413, "too_large"),
        (says('{"participants":["R9"],"algorithm":"late"}'), 502, "invalid"),
        (says('{"participants":[],"algorithm":"late"}'), 502, "invalid"),
        (says('{"participants":["R1"],"algorithm":"early"}'), 502, "invalid"),
        (says('{"robots":["R1"]}'), 502, "invalid"),
        (says('{"participants":["R1"],"algo'), 502, "invalid"),
        (says("I would choose R1."), 502, "invalid"),
        (says(""), 502, "invalid"),
    ],
)
def test_a_fault_is_told_with_its_code_and_the_next_answer_comes(
    behaviour: Behaviour, expected: int, code: str
) -> None:
    with serving_model() as server, gateway_of(server, breaker_failures=100) as client:
        server.otherwise = behaviour
        answer = decide(client, **ask(1))
        assert (answer.status, answer.error["code"]) == (expected, code)
        server.otherwise = says(GOOD)
        assert decide(client, **ask(2)).text == GOOD


@pytest.mark.parametrize(
    "words",
    [
        f"<think>R9 would be best, {{so}} early?</think>\n{GOOD}",
        f"R1 it is.</think>{GOOD}",
        f"Here you are:\n```json\n{json.dumps(json.loads(GOOD), indent=2)}\n```\nAs you like.",
        f"{{}} or rather {GOOD}",
    ],
)
def test_what_stands_around_the_json_is_left_out(words: str) -> None:
    with serving_model(says(words)) as server, gateway_of(server) as client:
        assert decide(client).text == GOOD


@pytest.mark.parametrize("behaviour", [hangs(), drips()])
def test_a_server_that_keeps_us_waiting_costs_no_more_than_the_deadline(
    behaviour: Behaviour,
) -> None:
    with serving_model(behaviour) as server, gateway_of(server) as client:
        answer = decide(client, 2.0, **ask(1))
        assert (answer.status, answer.error["code"]) == (504, "expired")
        # Its connection is closed, so the server need not go on.
        assert server.next_left()
        server.otherwise = says(GOOD)
        assert decide(client, **ask(2)).text == GOOD


def test_a_passing_fault_is_retried_within_the_deadline() -> None:
    with serving_model(refuses(500, "boom"), says(GOOD)) as server, gateway_of(server) as client:
        assert decide(client).text == GOOD
        assert client.count(CALLS) == 2


def test_a_server_that_is_down_is_used_once_it_is_up() -> None:
    server = ModelServer()
    server.port = free_port()
    server.otherwise = says(GOOD)
    try:
        with gateway_of(server, breaker_failures=100) as client:
            answer = decide(client, **ask(1))
            assert (answer.status, answer.error["code"]) == (503, "unavailable")
            assert answer.headers["retry-after"] == "1"
            server.start()
            assert decide(client, **ask(2)).text == GOOD
    finally:
        server.stop()


def test_a_server_that_keeps_failing_is_left_alone_and_tried_again() -> None:
    with serving_model() as server, gateway_of(server, breaker_failures=2, breaker_s=1.0) as client:
        server.otherwise = refuses(500, "boom")
        until(lambda: decide(client, **ask(1)).error["code"] == "unavailable", "it is left alone")
        assert client.count("coadapt_llm_breaker_state") == 2
        server.otherwise = says(GOOD)
        until(lambda: decide(client, **ask(9)).status == 200, "the breaker closes")
        assert client.count("coadapt_llm_breaker_state") == 0


def test_a_client_that_goes_away_ends_the_work_at_the_server() -> None:
    with serving_model(hangs()) as server, gateway_of(server) as client:
        raw = json.dumps({"messages": HELLO}).encode()
        with closing(http.client.HTTPConnection("127.0.0.1", client.port, timeout=20)) as to:
            to.request("POST", CHAT, raw, {"Content-Type": "application/json"})
            server.next()
        assert server.next_left()
        server.otherwise = says("Hello.")
        assert client.chat().text == "Hello."


def test_equal_requests_are_answered_from_the_cache_and_say_so() -> None:
    with serving_model() as server, gateway_of(server) as client:
        server.otherwise = says(GOOD)
        first, second = decide(client), decide(client)
        assert (first.text, second.text) == (GOOD, GOOD)
        assert first.body["coadapt"]["source"] == "llm"
        assert second.body["coadapt"]["source"] == "cache"
        assert second.body["coadapt"]["hit"] == "exact"
        assert server.asked.qsize() == 1


def test_ten_megabytes_never_reach_the_model() -> None:
    with serving_model() as server, gateway_of(server) as client:
        assert client.send("POST", CHAT, b"[" * 10_000_000).status == 413
        assert server.asked.empty()
