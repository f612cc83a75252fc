"""The back end `openai` with a real server: what it asks, and what it makes of what comes back."""

from __future__ import annotations

import asyncio
import io
import json
import re
import traceback
from collections.abc import Awaitable, Callable
from contextlib import redirect_stderr

import pytest

from llm_gateway.backends.openai import MAX_ANSWER_BYTES, OpenAi
from llm_gateway.backends.openai_wire import AGAIN_S, Dialect
from llm_gateway.model import Prompt, Reply
from swarm.errors import GatewayError, SettingError
from swarm.log import make_logger
from swarm.messages import ChatMessage, LlmTokens
from tests.support.free_ports import free_port
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

LOG = make_logger("test", level="critical")
KEY = "sk-test-0123456789abcdef"
SCHEMA = '{"type":"object","properties":{"b":{"enum":["x"]},"a":{"type":"integer"}}}'
PROMPT = Prompt((ChatMessage("system", "Decide."), ChatMessage("user", "R1")), SCHEMA, 32)
FREE = Prompt((ChatMessage("user", "Say something."),))


def with_backend(
    url: str, use: Callable[[OpenAi], Awaitable[None]], *, model: str = "m", key: str = ""
) -> None:
    """Runs a back end for as long as it is used."""

    async def run() -> None:
        backend = OpenAi(url, model, key, 4, LOG)
        await backend.start()
        try:
            await use(backend)
        finally:
            await backend.close()

    asyncio.run(run())


def reply(
    url: str, prompt: Prompt = PROMPT, *, model: str = "m", key: str = "", timeout_s: float = 20
) -> Reply:
    """One prompt's answer."""
    replies = []

    async def use(backend: OpenAi) -> None:
        replies.append(await backend.complete(prompt, timeout_s))

    with_backend(url, use, model=model, key=key)
    return replies[0]


def failure(url: str, prompt: Prompt = PROMPT, *, key: str = "", timeout_s: float = 20) -> str:
    """What one prompt's GatewayError says; its code comes first."""
    with pytest.raises(GatewayError) as caught:
        reply(url, prompt, key=key, timeout_s=timeout_s)
    assert str(caught.value).startswith(f"{caught.value.code}: ")
    return str(caught.value)


def form_of(server: ModelServer) -> str:
    return str(server.next().body.get("response_format", {}).get("type", "text"))


def test_a_prompt_and_its_schema_travel_in_openais_words() -> None:
    with serving_model(says('{"b":"x"}')) as server:
        assert reply(server.url, key=KEY).text == '{"b":"x"}'
        request = server.next()
    assert (request.method, request.path) == ("POST", "/v1/chat/completions")
    assert request.headers["authorization"] == f"Bearer {KEY}"
    assert request.body == {
        "model": "m",
        "messages": [
            {"role": "system", "content": "Decide."},
            {"role": "user", "content": "R1"},
        ],
        "stream": False,
        "max_tokens": 32,
        "temperature": 0,
        "response_format": {
            "type": "json_schema",
            "json_schema": {"name": "answer", "strict": True, "schema": json.loads(SCHEMA)},
        },
    }
    # Servers make grammars of it, in which the order of properties counts.
    assert list(request.body["response_format"]["json_schema"]["schema"]["properties"]) == [
        "b",
        "a",
    ]


def test_without_a_schema_no_form_is_asked_for() -> None:
    with serving_model(says("Hello.")) as server:
        assert reply(server.url, FREE).text == "Hello."
        assert "response_format" not in server.next().body


def test_tokens_are_told_as_far_as_the_server_tells_them() -> None:
    details = {"cached_tokens": 80}
    with serving_model(
        says("a", prompt_tokens=100, completion_tokens=9, prompt_tokens_details=details),
        says("a", prompt_tokens=None, completion_tokens=-4, prompt_tokens_details=None),
        status(200, json.dumps(completion("a") | {"usage": None})),
    ) as server:
        assert reply(server.url).tokens == LlmTokens(prompt=100, reused=80, output=9)
        assert reply(server.url).tokens == LlmTokens()
        assert reply(server.url).tokens == LlmTokens()


def test_a_server_that_reads_only_json_object_is_found_out_once() -> None:
    # The words of llama-cpp-python's server.
    strange = refuses(500, "{'loc': ('body', 'response_format', 'type'), 'msg': 'Input should be'}")

    async def use(backend: OpenAi) -> None:
        for _ in range(2):
            await backend.complete(PROMPT, 20)

    with serving_model(strange, says("{}"), says("{}")) as server:
        with_backend(server.url, use)
        assert [form_of(server) for _ in range(3)] == ["json_schema", "json_object", "json_object"]


def test_a_server_without_structured_output_is_told_the_schema_in_words() -> None:
    no = refuses(400, "unknown field")
    with serving_model(no, refuses(422, "unknown field"), says("{}")) as server:
        assert reply(server.url).text == "{}"
        server.next()
        assert server.next().body["response_format"] == {
            "type": "json_object",
            "schema": json.loads(SCHEMA),
        }
        last = server.next().body
    assert "response_format" not in last
    assert last["messages"][0]["content"] == "Decide."
    assert last["messages"][1]["content"].startswith("R1\n\n")
    assert last["messages"][1]["content"].endswith(SCHEMA)


def test_one_refused_schema_does_not_take_the_form_from_others() -> None:
    async def use(backend: OpenAi) -> None:
        for _ in range(3):
            await backend.complete(PROMPT, 20)

    with serving_model(says("{}"), refuses(400, "odd schema"), says("{}"), says("{}")) as server:
        with_backend(server.url, use)
        forms = [form_of(server) for _ in range(4)]
    assert forms == ["json_schema", "json_schema", "json_object", "json_schema"]


def test_better_forms_are_tried_again_after_a_while() -> None:
    dialect = Dialect()
    dialect.learn("text", now=5.0)
    assert dialect.forms(now=5.0) == ("text",)
    assert dialect.forms(now=5.0 + AGAIN_S)[0] == "json_schema"
    dialect.learn("json_schema", now=5.0 + AGAIN_S)
    assert dialect.forms(now=6.0 + AGAIN_S)[0] == "json_schema"


def test_models_that_know_other_fields_are_asked_with_those() -> None:
    with serving_model(
        refuses(400, "Use max_completion_tokens.", param="max_tokens"),
        refuses(400, "Only the default (1).", param="temperature"),
        says("{}"),
    ) as server:
        reply(server.url)
        bodies = [server.next().body for _ in range(3)]
    assert bodies[2]["max_completion_tokens"] == 32
    assert not {"max_tokens", "temperature"} & set(bodies[2])
    assert all("response_format" in body for body in bodies)


def test_a_refusal_that_nothing_mends_ends_after_every_form() -> None:
    with serving_model() as server:
        server.otherwise = refuses(400, "no", param="max_tokens")
        assert failure(server.url) == f"failed: {server.url}/v1 answered 400: no"
        assert server.asked.qsize() == 4


def test_without_a_name_the_first_listed_model_is_taken() -> None:
    with serving_model() as server:
        server.models = ["first", "second"]

        async def use(backend: OpenAi) -> None:
            assert backend.model == "first"
            await backend.complete(FREE, 20)

        with_backend(server.url, use, model="")
        assert server.next().body["model"] == "first"


def test_a_server_that_comes_later_is_asked_for_its_model_then() -> None:
    server = ModelServer()
    server.port = free_port()

    async def use(backend: OpenAi) -> None:
        assert backend.model == "unknown"
        with pytest.raises(GatewayError, match=r"^unavailable: "):
            await backend.complete(FREE, 20)
        server.start()
        await backend.complete(FREE, 20)
        assert backend.model == "test-model"

    try:
        with_backend(server.url, use, model="")
    finally:
        server.stop()


def test_a_server_with_another_model_than_before_is_asked_again() -> None:
    async def use(backend: OpenAi) -> None:
        server.models = ["other"]
        with pytest.raises(GatewayError, match=r"^failed: .*404"):
            await backend.complete(FREE, 20)
        await backend.complete(FREE, 20)
        assert backend.model == "other"

    with serving_model(refuses(404, "no such model"), says("a")) as server:
        with_backend(server.url, use, model="")


@pytest.mark.parametrize(
    ("behaviour", "said"),
    [
        (status(429, "slow down", Retry_After="7"), "unavailable: .*429: slow down; .* in 7 s"),
        (refuses(503, "Loading model"), "unavailable: .*503: Loading model"),
        (status(429, "later", Retry_After="Fri, 31 Dec 2199 23:59:59 GMT"), "unavailable: .*429"),
        (resets(), "unavailable: .* cannot be reached: "),
        (refuses(500, "boom\r\n\x1b[31m"), r"failed: .* answered 500: boom \[31m$"),
        (status(502, ""), "failed: .* answered 502"),
        (refuses(404, "no such model"), "failed: .*404: no such model"),
        (status(302, "", Location="/elsewhere"), "failed: .*302"),
        (refuses(401, "wrong key"), "failed: .*401: it does not accept the API key"),
        (status(200, "<html>"), "failed: .*no chat completion"),
        (status(200, json.dumps(completion("{}"))[:-9]), "failed: .*no chat completion"),
        (status(200, "[" * 100_000), "failed: .*no chat completion"),
        (status(200, "[]"), "failed: .*no chat completion"),
        (status(200, '{"choices": []}'), "failed: .*without choices"),
        (status(200, '{"error": {"message": "x"}}'), "failed: .*no chat completion"),
        (says(None), "failed: .*no chat completion"),
        (says(["{}"]), "failed: .*no chat completion"),
        (breaks_off(b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\n{"), "failed: "),
        (breaks_off(b"SSH-2.0-OpenSSH_9.6\r\n\r\n"), "failed: .*does not speak HTTP"),
        (floods(MAX_ANSWER_BYTES + 1), "failed: .*more than 4000000 bytes"),
        (status(413, "request entity too large"), "too_large: .*413"),
        (
            refuses(400, "Please shorten.", code="context_length_exceeded"),
            "too_large: .*400: Please shorten",
        ),
        (
            refuses(400, "the request exceeds the available context size, try increasing it"),
            "too_large: ",
        ),
        (
            refuses(400, "This model's maximum context length is 4096 tokens. However, you"),
            "too_large: ",
        ),
        (refuses(500, "Requested tokens (9000) exceed context window of 4096"), "too_large: "),
    ],
)
def test_trouble_has_a_code_and_a_line_of_text(behaviour: Behaviour, said: str) -> None:
    with serving_model(behaviour) as server:
        text = failure(server.url)
        assert len(text) < 400
        assert text.isprintable()
        assert re.match(said, text), text


@pytest.mark.parametrize("behaviour", [hangs(), drips()])
def test_a_server_that_keeps_us_waiting_is_left_at_the_deadline(behaviour: Behaviour) -> None:
    with serving_model(behaviour) as server:
        assert failure(server.url, timeout_s=2.0).startswith("expired: ")
        assert server.next_left()


def test_nobody_there_is_unavailable() -> None:
    assert failure(f"http://127.0.0.1:{free_port()}").startswith("unavailable: ")
    assert failure("http://no-such-host.invalid").startswith("unavailable: ")


def test_cancelling_ends_the_work_at_the_server() -> None:
    async def use(backend: OpenAi) -> None:
        work = asyncio.ensure_future(backend.complete(PROMPT, 20))
        await asyncio.to_thread(server.next)
        work.cancel()
        with pytest.raises(asyncio.CancelledError):
            await work
        await asyncio.to_thread(server.next_left)

    with serving_model(hangs()) as server:
        with_backend(server.url, use)


def test_closing_ends_what_is_under_way_as_unavailable() -> None:
    async def use(backend: OpenAi) -> None:
        work = asyncio.ensure_future(backend.complete(PROMPT, 20))
        await asyncio.to_thread(server.next)
        await backend.close()
        with pytest.raises(GatewayError, match=r"^unavailable: "):
            await work
        with pytest.raises(GatewayError, match=r"^unavailable: "):
            await backend.complete(PROMPT, 20)

    with serving_model(hangs()) as server:
        with_backend(server.url, use)


def test_a_schema_from_the_network_cannot_add_fields_to_the_request() -> None:
    with serving_model() as server:
        smuggled = Prompt(FREE.messages, '{}}, "model": "other", "x": {"y": {}')
        assert failure(server.url, smuggled).startswith("failed: the schema is no JSON object")
        assert server.asked.empty()


@pytest.mark.parametrize("code", [200, 400, 401, 403, 404, 429, 500, 503])
def test_the_key_is_in_no_error_and_no_log(code: int) -> None:
    quoted = f"Incorrect API key provided: {KEY}. Authorization: Bearer {KEY}"
    log = io.StringIO()

    async def use(backend: OpenAi) -> None:
        backend._log = make_logger("test", level="debug")
        assert KEY not in repr(backend) + str(backend)
        try:
            await backend.complete(PROMPT, 20)
        except GatewayError as error:
            log.write("".join(traceback.format_exception(error)) + repr(error))
            cause: BaseException | None = error.__cause__
            assert cause is None
        await backend.close()
        await backend.start()

    with serving_model() as server, redirect_stderr(log):
        server.otherwise = refuses(code, quoted) if code != 200 else status(200, quoted)
        server.models = [f"model {KEY}" * 20]
        with_backend(server.url, use, key=KEY)
    assert "GatewayError" in log.getvalue() or "PromptRefusedError" in log.getvalue()
    assert KEY not in log.getvalue()


@pytest.mark.parametrize(
    "url",
    [
        "",
        "127.0.0.1:8000",
        "ftp://h/v1",
        "http://",
        "http://h:99999",
        "http://h:0",
        "http://h/v 1",
        f"http://user:{KEY}@h/v1",
        f"http://h/v1?key={KEY}",
    ],
)
def test_a_wrong_address_is_refused_at_once(url: str) -> None:
    with pytest.raises(SettingError) as caught:
        OpenAi(url, "m", "", 1, LOG)
    assert KEY not in str(caught.value)


def test_a_key_that_no_header_can_hold_is_refused_without_showing_it() -> None:
    with pytest.raises(SettingError) as caught:
        OpenAi("http://h", "m", f"{KEY}\r\nX-Other: 1", 1, LOG)
    assert KEY not in str(caught.value)


@pytest.mark.parametrize("path", ["", "/", "/v1", "/v1/", "/openai/v1"])
def test_the_address_may_leave_out_v1(path: str) -> None:
    with serving_model(says("a")) as server:
        reply(server.url + path, FREE)
        prefix = "/openai/v1" if path.startswith("/openai") else "/v1"
        assert server.next().path == f"{prefix}/chat/completions"
