"""The HTTP endpoint: OpenAI's words in and out, what it refuses, and clients that go away."""

from __future__ import annotations

import asyncio
import http.client
import json
import socket
from collections.abc import Generator
from contextlib import closing
from typing import Any

import pytest
from prometheus_client import CollectorRegistry

from llm_gateway.http_app import MAX_BODY_BYTES
from llm_gateway.http_endpoint import HttpEndpoint
from llm_gateway.model import Completion, Job
from swarm.errors import GatewayCode, GatewayError, SettingError
from swarm.messages import ChatMessage
from swarm.messages.llm import MAX_PROMPT_CHARS
from tests.support.llm_endpoint import CHAT, HELLO, LOG, Client, Scripted, endpoint_of

TOKEN = "s3cret-token"
FORMAT = {"type": "json_schema", "json_schema": {"name": "a", "schema": {"type": "object"}}}


@pytest.fixture(scope="module")
def shared() -> Generator[tuple[Scripted, Client]]:
    gateway = Scripted()
    with endpoint_of(gateway) as client:
        yield gateway, client


@pytest.fixture
def gateway(shared: tuple[Scripted, Client]) -> Scripted:
    shared[0].reset()
    return shared[0]


@pytest.fixture
def endpoint(shared: tuple[Scripted, Client], gateway: Scripted) -> Client:
    return shared[1]


def job_of(gateway: Scripted) -> Job:
    return gateway.jobs.get(timeout=20)[0]


def test_an_answer_has_openais_shape_and_says_where_it_comes_from(endpoint: Client) -> None:
    answer = endpoint.chat(model="default")
    assert answer.status == 200
    assert answer.headers["content-type"] == "application/json"
    body = answer.body
    assert body.pop("id").startswith("chatcmpl-")
    assert isinstance(body.pop("created"), int)
    message = {"role": "assistant", "content": "Hello."}
    assert body == {
        "object": "chat.completion",
        "model": "test-model",
        "choices": [{"index": 0, "message": message, "finish_reason": "stop"}],
        "usage": {
            "prompt_tokens": 30,
            "completion_tokens": 4,
            "total_tokens": 34,
            "prompt_tokens_details": {"cached_tokens": 20},
        },
        "coadapt": {
            "source": "cache",
            "hit": "exact",
            "age_s": 2.5,
            "timings": {"queue_ms": 1.0, "model_ms": 2.0, "total_ms": 3.0},
        },
    }


def test_messages_may_come_in_parts(endpoint: Client, gateway: Scripted) -> None:
    parts = [{"type": "text", "text": "Hel"}, {"type": "text", "text": "lo."}]
    turns = [
        {"role": "developer", "content": "Be brief.", "name": "x"},
        {"role": "assistant", "content": "Yes."},
        {"role": "user", "content": parts},
    ]
    assert endpoint.chat(messages=turns).text == "Hello."
    assert job_of(gateway).prompt.messages == (
        ChatMessage("system", "Be brief."),
        ChatMessage("assistant", "Yes."),
        ChatMessage("user", "Hello."),
    )


@pytest.mark.parametrize(
    ("asked", "schema"),
    [
        (None, ""),
        ({"type": "text"}, ""),
        ({"type": "json_object"}, '{"type":"object"}'),
        ({"type": "json_object", "schema": {"minProperties": 1}}, '{"minProperties":1}'),
        (
            {
                "type": "json_schema",
                "json_schema": {
                    "name": "d",
                    "strict": True,
                    "schema": {"properties": {"z": {}, "a": {}}},
                },
            },
            '{"properties":{"z":{},"a":{}}}',
        ),
    ],
)
def test_the_response_format_becomes_the_schema(
    endpoint: Client, gateway: Scripted, asked: Any, schema: str
) -> None:
    assert endpoint.chat(response_format=asked).status == 200
    assert job_of(gateway).prompt.schema == schema


def test_lengths_clients_and_deadlines_have_defaults(endpoint: Client, gateway: Scripted) -> None:
    assert endpoint.chat().status == 200
    job, now = gateway.jobs.get(timeout=20)
    assert (job.prompt.max_tokens, job.client, job.fingerprint) == (256, "127.0.0.1", "")
    assert 50 < job.deadline - now <= 60


def test_headers_and_fields_replace_them(endpoint: Client, gateway: Scripted) -> None:
    headers = {
        "X-CoAdapt-Deadline": "2.5",
        "X-CoAdapt-Client": "planner-1",
        "X-CoAdapt-Fingerprint": "0123456789abcdef",
    }
    assert endpoint.chat(headers=headers, max_tokens=9, max_completion_tokens=7).status == 200
    job, now = gateway.jobs.get(timeout=20)
    assert (job.prompt.max_tokens, job.client) == (7, "planner-1")
    assert job.fingerprint == "0123456789abcdef"
    assert job.deadline - now <= 2.5


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"stop": ["a", "b", "c", "d", "e"]}, "stop"),
        ({"stop": [""]}, "stop"),
        ({"temperature": 2.1}, "temperature"),
        ({"top_p": -0.1}, "top_p"),
        ({"seed": 0.5}, "seed"),
        ({"presence_penalty": 0.5}, "presence_penalty = 0.5"),
        ({"logprobs": True}, "logprobs"),
        ({"n": 2}, "n = 2"),
        ({"tools": [{}]}, "tools"),
        ({"messages": []}, "messages"),
        ({"messages": HELLO * 65}, "messages"),
        ({"messages": [{"role": "tool", "content": "x"}]}, "role"),
        ({"messages": [{"role": "user", "content": None}]}, "content"),
        ({"messages": [{"role": "user", "content": [{"type": "image_url"}]}]}, "image_url"),
        ({"max_tokens": 0}, "max_tokens"),
        ({"max_tokens": 4097}, "max_tokens"),
        ({"response_format": {"type": "grammar"}}, "grammar"),
        ({"response_format": {"type": "json_schema"}}, "json_schema"),
        ({"response_format": {"type": "json_object", "schema": {"type": "foo"}}}, "foo"),
    ],
)
def test_what_is_not_offered_is_refused_and_named(
    endpoint: Client, gateway: Scripted, fields: dict[str, Any], named: str
) -> None:
    answer = endpoint.chat(**fields)
    assert answer.status == 400
    assert answer.error["type"] == "invalid_request_error"
    assert named in answer.error["message"]
    assert gateway.jobs.empty()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("X-CoAdapt-Deadline", "soon"),
        ("X-CoAdapt-Deadline", "nan"),
        ("X-CoAdapt-Deadline", "0"),
        ("X-CoAdapt-Deadline", "601"),
        ("X-CoAdapt-Client", "a/b"),
        ("X-CoAdapt-Client", "x" * 33),
        ("X-CoAdapt-Fingerprint", "0123"),
        ("X-CoAdapt-Fingerprint", "XYZ"),
    ],
)
def test_a_malformed_header_is_refused_and_named(endpoint: Client, name: str, value: str) -> None:
    answer = endpoint.chat(headers={name: value})
    assert answer.status == 400
    assert f"{name} = {value!r}" in answer.error["message"]


@pytest.mark.parametrize("raw", [b"", b"{", b"[]", b"null", b"\xff", b"[" * 100_000, b'{"a":1}'])
def test_a_body_that_is_no_request_is_refused(endpoint: Client, raw: bytes) -> None:
    answer = endpoint.send("POST", CHAT, raw)
    assert answer.status == 400
    assert "no chat completion request" in answer.error["message"]


def test_a_web_page_cannot_ask(endpoint: Client) -> None:
    # A browser sends such a body elsewhere without asking first.
    raw = json.dumps({"messages": HELLO}).encode()
    assert endpoint.send("POST", CHAT, raw, {"Content-Type": "text/plain"}).status == 415


def test_only_our_model_is_here(endpoint: Client) -> None:
    for name in (None, "", "default", "test-model"):
        assert endpoint.chat(model=name).status == 200
    answer = endpoint.chat(model="gpt-9")
    assert (answer.status, answer.error["code"]) == (404, "model_not_found")
    assert "'test-model'" in answer.error["message"]
    assert [m["id"] for m in endpoint.send("GET", "/v1/models").body["data"]] == ["test-model"]


@pytest.mark.parametrize(
    ("code", "status", "kind"),
    [
        ("expired", 504, "server_error"),
        ("busy", 429, "rate_limit_error"),
        ("too_large", 413, "invalid_request_error"),
        ("unavailable", 503, "server_error"),
        ("failed", 502, "server_error"),
        ("invalid", 502, "server_error"),
    ],
)
def test_each_code_of_the_gateway_has_a_status(
    endpoint: Client, gateway: Scripted, code: GatewayCode, status: int, kind: str
) -> None:
    async def refuse(job: Job) -> Completion:
        raise GatewayError(code, "because")

    gateway.answer = refuse
    before = endpoint.count("coadapt_llm_http_requests_total", status=str(status))
    answer = endpoint.chat()
    assert (answer.status, answer.error["code"], answer.error["type"]) == (status, code, kind)
    assert answer.error["message"] == f"{code}: because"
    assert ("retry-after" in answer.headers) == (status in (429, 503))
    assert endpoint.count("coadapt_llm_http_requests_total", status=str(status)) == before + 1


def test_a_fault_of_ours_is_500_and_says_nothing_of_the_inside(
    endpoint: Client, gateway: Scripted
) -> None:
    async def fail(job: Job) -> Completion:
        raise RuntimeError("inside")

    gateway.answer = fail
    answer = endpoint.chat()
    assert answer.status == 500
    assert "inside" not in answer.error["message"]
    gateway.answer = gateway.echo
    assert endpoint.chat().status == 200


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [("GET", CHAT, 405), ("POST", "/v1/models", 405), ("GET", "/v1/embeddings", 404)],
)
def test_other_paths_are_refused_in_openais_shape(
    endpoint: Client, method: str, path: str, status: int
) -> None:
    answer = endpoint.send(method, path)
    assert answer.status == status
    assert path in answer.error["message"]


def test_more_characters_than_a_prompt_may_have_are_too_large(endpoint: Client) -> None:
    content = "x" * (MAX_PROMPT_CHARS + 1)
    answer = endpoint.chat(messages=[{"role": "user", "content": content}])
    assert (answer.status, answer.error["code"]) == (413, "too_large")
    odd = {"type": "json_object", "schema": {"enum": ["x" * 50_001]}}
    assert endpoint.chat(response_format=odd).status == 413


def test_ten_megabytes_are_refused_and_the_endpoint_goes_on(
    endpoint: Client, gateway: Scripted
) -> None:
    answer = endpoint.send("POST", CHAT, b" " * 10_000_000)
    assert (answer.status, answer.error["code"]) == (413, "too_large")
    assert str(MAX_BODY_BYTES) in answer.error["message"]
    assert gateway.jobs.empty()
    assert endpoint.chat().status == 200


def test_a_client_that_goes_away_takes_its_job_along(endpoint: Client, gateway: Scripted) -> None:
    async def wait(job: Job) -> Completion:
        await asyncio.Event().wait()
        raise AssertionError

    gateway.answer = wait
    raw = json.dumps({"messages": HELLO}).encode()
    with closing(http.client.HTTPConnection("127.0.0.1", endpoint.port, timeout=20)) as to:
        to.request("POST", CHAT, raw, {"Content-Type": "application/json"})
        job = job_of(gateway)
    assert gateway.cancelled.get(timeout=20) == job


def test_a_client_that_goes_away_within_its_body_harms_nobody(
    endpoint: Client, gateway: Scripted
) -> None:
    with closing(socket.create_connection(("127.0.0.1", endpoint.port))) as to:
        to.sendall(
            f"POST {CHAT} HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
            "Content-Length: 1000\r\n\r\n{".encode()
        )
    assert endpoint.chat().status == 200
    assert gateway.jobs.qsize() == 1


def test_the_token_is_asked_for_everywhere_but_at_health(gateway: Scripted) -> None:
    with endpoint_of(gateway, TOKEN) as endpoint:
        assert endpoint.send("GET", "/healthz").body == {"status": "ok"}
        for wrong in ("", "Bearer", "Bearer other", f"Basic {TOKEN}", "Bearer s3cret-tokeX"):
            answer = endpoint.chat(headers={"Authorization": wrong} if wrong else {})
            assert (answer.status, answer.error["code"]) == (401, "invalid_api_key")
            assert answer.headers["www-authenticate"] == "Bearer"
            assert TOKEN not in str(answer)
        assert endpoint.send("GET", "/v1/models").status == 401
        assert gateway.jobs.empty()
        assert endpoint.chat(headers={"Authorization": f"bearer {TOKEN}"}).status == 200


@pytest.mark.parametrize("host", ["evil.example", "evil.example:9106", "10.0.0.1", "[::"])
def test_a_name_that_somebody_had_lead_here_is_refused(
    gateway: Scripted, endpoint: Client, host: str
) -> None:
    answer = endpoint.chat(headers={"Host": host})
    assert (answer.status, answer.error["code"]) == (403, "host")
    assert "this host's own addresses" in answer.error["message"]
    assert gateway.jobs.empty()


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:9106", "[::1]"])
def test_this_hosts_own_names_are_answered(endpoint: Client, host: str) -> None:
    assert endpoint.send("GET", "/v1/models", headers={"Host": host}).status == 200


def test_names_of_the_list_are_answered_also_with_a_token_and_others_never(
    gateway: Scripted,
) -> None:
    shown = {"Authorization": f"Bearer {TOKEN}", "Host": "llm.plant:9106"}
    with endpoint_of(gateway, TOKEN) as endpoint:
        answer = endpoint.chat(headers=shown)
        assert (answer.status, answer.error["code"]) == (403, "host")
    with endpoint_of(gateway, TOKEN, ["llm.plant"]) as endpoint:
        assert endpoint.chat(headers=shown).status == 200
        assert endpoint.chat(headers={"Host": "llm.plant"}).status == 401


def test_other_hosts_need_a_token(gateway: Scripted) -> None:
    with pytest.raises(SettingError, match=r"COADAPT_LLM_HTTP_HOST = '0\.0\.0\.0'"):
        HttpEndpoint(gateway, "0.0.0.0", 0, "", CollectorRegistry(), LOG)
    with pytest.raises(SettingError, match="COADAPT_LLM_HTTP_TOKEN") as caught:
        HttpEndpoint(gateway, "127.0.0.1", 0, "two words", CollectorRegistry(), LOG)
    assert "two words" not in str(caught.value)


def test_a_port_that_is_taken_is_named(gateway: Scripted, endpoint: Client) -> None:
    with pytest.raises(SettingError, match=f"COADAPT_LLM_HTTP_PORT = {endpoint.port} "):
        HttpEndpoint(gateway, "127.0.0.1", endpoint.port, "", CollectorRegistry(), LOG)


def test_answers_do_not_wait_for_acknowledgements(gateway: Scripted) -> None:
    endpoint = HttpEndpoint(gateway, "127.0.0.1", 0, "", CollectorRegistry(), LOG)
    assert endpoint._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    asyncio.run(endpoint.close())
