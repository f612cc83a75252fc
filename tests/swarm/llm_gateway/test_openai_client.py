"""OpenAI's own client against a gateway's process: what its users expect, case by case."""

from __future__ import annotations

import asyncio
import threading
import traceback
from collections.abc import Callable, Iterator
from typing import Any, Literal

import openai
import pydantic
import pytest
from openai import OpenAI

from tests.support.first_hour import Figure
from tests.support.free_ports import free_port
from tests.support.gateway_process import GatewayProcess, gateway_process
from tests.support.model_server import (
    ModelServer,
    hangs,
    refuses,
    says,
    serving_model,
    streams,
)

MODEL = "test-org/test-model"
TOKEN = "clients-token"
Case = Callable[["Shop"], None]
CASES: list[Case] = []


class Shop:
    """A gateway, the model server behind it, and a client before it."""

    def __init__(self, server: ModelServer, gateway: GatewayProcess) -> None:
        self.server = server
        self.gateway = gateway
        self.client = self.client_with(TOKEN)
        self._number = 0

    def client_with(self, token: str) -> OpenAI:
        return OpenAI(base_url=self.gateway.url, api_key=token, max_retries=0, timeout=30)

    def say(self, words: str = "", **fields: Any) -> Any:
        """One chat; a fresh question unless words are given."""
        self._number += 1
        asked = [{"role": "user", "content": words or f"Question {self._number}?"}]
        return self.client.chat.completions.create(**({"model": MODEL, "messages": asked} | fields))

    def refused(self, kind: type[openai.APIStatusError], **fields: Any) -> openai.APIStatusError:
        with pytest.raises(kind) as caught:
            self.say(**fields)
        return caught.value


def case(run: Case) -> Case:
    CASES.append(run)
    return run


@pytest.fixture(scope="module")
def shop() -> Iterator[Shop]:
    with (
        serving_model() as server,
        gateway_process(
            LLM_BACKEND="openai", LLM_URL=server.url, LLM_MODEL=MODEL, LLM_HTTP_TOKEN=TOKEN
        ) as gateway,
    ):
        yield Shop(server, gateway)


def text_of(stream: Any) -> tuple[str, list[Any]]:
    """A stream's words put together, and its chunks."""
    chunks = list(stream)
    words = [c.choices[0].delta.content or "" for c in chunks if c.choices]
    return "".join(words), chunks


@case
def an_answer_tells_text_model_end_and_tokens(shop: Shop) -> None:
    shop.server.plan.append(says("Hello."))
    answer = shop.say()
    assert answer.choices[0].message.content == "Hello."
    assert answer.choices[0].message.role == "assistant"
    assert answer.choices[0].finish_reason == "stop"
    assert answer.model == MODEL
    usage = answer.usage
    assert (usage.prompt_tokens, usage.completion_tokens, usage.total_tokens) == (100, 7, 107)


@case
def an_answer_that_is_cut_says_so(shop: Shop) -> None:
    for _ in range(2):  # also the second time
        shop.server.plan.append(says("Once upon", finish="length"))
        answer = shop.say("A story?", max_tokens=2)
        assert answer.choices[0].finish_reason == "length"
        assert shop.server.asked.get(timeout=5).body["max_tokens"] == 2


@case
def a_stop_sequence_ends_the_answer_whatever_the_server_does(shop: Shop) -> None:
    for stop in ("\n", ["zzz", "\n", ";"]):
        shop.server.plan.append(says("one\ntwo; three"))
        answer = shop.say(stop=stop)
        assert answer.choices[0].message.content == "one"
        assert answer.choices[0].finish_reason == "stop"
        passed = shop.server.next().body["stop"]
        assert passed == ([stop] if isinstance(stop, str) else stop)


@case
def five_stop_sequences_are_refused(shop: Shop) -> None:
    error = shop.refused(openai.BadRequestError, stop=list("abcde"))
    assert error.param == "stop"
    assert error.type == "invalid_request_error"


@case
def temperature_top_p_and_seed_reach_the_model(shop: Shop) -> None:
    shop.server.plan.append(says("x"))
    shop.say(temperature=0.7, top_p=0.9, seed=42)
    body = shop.server.next().body
    assert (body["temperature"], body["top_p"], body["seed"]) == (0.7, 0.9, 42)


@case
def chance_is_never_answered_from_the_cache_but_equal_seeds_are(shop: Shop) -> None:
    def asked(**fields: Any) -> list[str]:
        return [shop.say("Heads or tails?", **fields).choices[0].message.content for _ in "12"]

    for words in ("heads", "tails", "edge", "left", "right"):
        shop.server.plan.append(says(words))
    assert asked(temperature=1) == ["heads", "tails"]
    assert asked(temperature=1, seed=1) == ["edge", "edge"]
    assert asked(temperature=1, seed=2) == ["left", "left"]
    assert asked() == ["right", "right"]


@case
def models_are_listed_and_told_one_by_one(shop: Shop) -> None:
    assert [model.id for model in shop.client.models.list()] == [MODEL]
    model = shop.client.models.retrieve(MODEL)
    assert (model.id, model.object) == (MODEL, "model")


@case
def a_model_that_is_not_there_is_not_found(shop: Shop) -> None:
    with pytest.raises(openai.NotFoundError) as caught:
        shop.client.models.retrieve("gpt-9")
    assert caught.value.code == "model_not_found"
    error = shop.refused(openai.NotFoundError, model="gpt-9")
    assert (error.code, error.param) == ("model_not_found", "model")


@case
def a_stream_tells_words_while_the_model_is_at_it(shop: Shop) -> None:
    go = threading.Event()
    shop.server.plan.append(streams("Once ", "upon ", "a time", go=go))
    stream = iter(shop.say(stream=True))
    first = ""
    while not first:
        first = next(stream).choices[0].delta.content or ""
    assert first == "Once "
    assert not go.is_set()
    go.set()
    rest, chunks = text_of(stream)
    assert rest == "upon a time"
    assert chunks[-1].choices[0].finish_reason == "stop"
    assert len({chunk.id for chunk in chunks}) == 1


@case
def a_stream_tells_its_tokens_where_asked(shop: Shop) -> None:
    shop.server.plan.append(streams("a", "b", finish="length"))
    text, chunks = text_of(shop.say(stream=True, stream_options={"include_usage": True}))
    assert text == "ab"
    assert chunks[-2].choices[0].finish_reason == "length"
    assert chunks[-1].choices == []
    assert chunks[-1].usage.total_tokens == 13
    assert all(chunk.usage is None for chunk in chunks[:-1])


@case
def a_stream_holds_back_what_may_be_a_stop_sequence(shop: Shop) -> None:
    shop.server.plan.append(streams("on", "e E", "N", "d two EN", "D three"))
    text, chunks = text_of(shop.say(stream=True, stop="END"))
    assert text == "one ENd two "
    assert chunks[-1].choices[0].finish_reason == "stop"


@case
def what_the_cache_knows_can_be_streamed(shop: Shop) -> None:
    shop.server.plan.append(says("known"))
    shop.say("Do you know?")
    text, chunks = text_of(shop.say("Do you know?", stream=True))
    assert text == "known"
    assert chunks[-1].coadapt["hit"] == "exact"


@case
def an_error_before_the_first_word_has_its_status(shop: Shop) -> None:
    shop.server.otherwise = refuses(500, "out of memory")
    error = shop.refused(openai.InternalServerError, stream=True)
    shop.server.otherwise = says("{}")
    assert error.status_code == 502
    assert "out of memory" in error.message


@case
def an_error_after_the_first_word_is_raised_too(shop: Shop) -> None:
    shop.server.plan.append(streams("Once ", "upon", finish=None))
    heard: list[str] = []

    def listen() -> None:
        for chunk in shop.say(stream=True):
            heard.append(chunk.choices[0].delta.content or "")

    with pytest.raises(openai.APIError, match="broke its answer off"):
        listen()
    assert "".join(heard) == "Once upon"


@case
def leaving_a_stream_ends_the_work_on_it(shop: Shop) -> None:
    go = threading.Event()
    shop.server.plan.append(streams("Once ", "upon", go=go))
    with shop.say(stream=True) as stream:
        next(iter(stream))
    assert shop.server.next_left().body["stream"]
    go.set()


@case
def the_asynchronous_client_streams_too(shop: Shop) -> None:
    async def ask() -> str:
        async with openai.AsyncOpenAI(base_url=shop.gateway.url, api_key=TOKEN) as client:
            stream = await client.chat.completions.create(
                model="default", messages=[{"role": "user", "content": "Async?"}], stream=True
            )
            return "".join([chunk.choices[0].delta.content or "" async for chunk in stream])

    shop.server.plan.append(streams("y", "es"))
    assert asyncio.run(ask()) == "yes"


@case
def an_answer_becomes_an_object_of_the_clients(shop: Shop) -> None:
    class Choice(pydantic.BaseModel):
        robot: Literal["R1", "R2"]

    shop.server.plan.append(says('Certainly: {"robot": "R2"}'))
    parsed = shop.client.chat.completions.parse(
        model=MODEL, messages=[{"role": "user", "content": "Which?"}], response_format=Choice
    )
    assert parsed.choices[0].message.parsed == Choice(robot="R2")


@case
def a_wrong_token_is_an_authentication_error(shop: Shop) -> None:
    with pytest.raises(openai.AuthenticationError) as caught:
        shop.client_with("wrong").models.list()
    assert caught.value.code == "invalid_api_key"


@case
def what_is_not_offered_is_a_bad_request_that_names_it(shop: Shop) -> None:
    tool = {"type": "function", "function": {"name": "f", "parameters": {"type": "object"}}}
    asked: dict[str, Any] = {
        "tools": [tool],
        "n": 2,
        "logprobs": True,
        "frequency_penalty": 1.0,
        "temperature": 3,
        "top_p": 1.5,
        "max_tokens": 0,
    }
    for name, value in asked.items():
        assert shop.refused(openai.BadRequestError, **{name: value}).param == name


@case
def what_the_model_server_refuses_is_a_bad_request_and_does_not_open_the_breaker(
    shop: Shop,
) -> None:
    for _ in range(8):
        shop.server.plan.append(refuses(400, "Only the default (1).", param="temperature"))
        error = shop.refused(openai.BadRequestError, temperature=0.5)
        assert "Only the default" in error.message
    shop.server.plan.append(says("well"))
    assert shop.say().choices[0].message.content == "well"


@case
def fields_that_nobody_knows_change_nothing(shop: Shop) -> None:
    shop.server.plan.append(says("fine"))
    answer = shop.say(user="u", metadata={"a": "b"}, extra_body={"top_k": 3, "presence_penalty": 0})
    assert answer.choices[0].message.content == "fine"


@case
def a_deadline_that_passes_is_told(shop: Shop) -> None:
    shop.server.plan.append(hangs())
    error = shop.refused(openai.InternalServerError, extra_headers={"X-CoAdapt-Deadline": "0.2"})
    assert (error.status_code, error.code) == (504, "expired")


@pytest.mark.stumble(
    "the OpenAI client finds finish_reason, stop, seed, streams and models wrong or missing",
    command="python -c 'import openai; openai.OpenAI(base_url=\"http://127.0.0.1:9106/v1\", ...)'",
)
def test_openais_client_finds_what_it_expects(shop: Shop, figure: Figure) -> None:
    failed = []
    for run in CASES:
        shop.server.plan.clear()
        try:
            run(shop)
        except Exception:
            failed.append(f"{run.__name__}: {traceback.format_exc(limit=-3)}")
        while not shop.server.asked.empty():
            shop.server.asked.get()
    figure("openai_client_cases", len(CASES) - len(failed))
    assert not failed, "\n".join(failed)
    assert len(CASES) >= 12


@pytest.mark.stumble(
    "an unreachable model server is told every second, and not called that",
    command="make up LLM=http://127.0.0.1:9 MODEL=x; make logs ARGS=gateway",
)
def test_a_server_that_cannot_be_reached_is_told_once_each_way() -> None:
    port = free_port()
    settings = {"LLM_BACKEND": "openai", "LLM_URL": f"http://127.0.0.1:{port}"}
    with gateway_process(**settings, LLM_MODEL=MODEL, LLM_BREAKER_S="0.1") as gateway:
        client = OpenAI(base_url=gateway.url, api_key="none", max_retries=0)
        for number in range(8):
            with pytest.raises(openai.InternalServerError) as caught:
                client.chat.completions.create(
                    model=MODEL, messages=[{"role": "user", "content": f"{number}?"}]
                )
            assert caught.value.status_code == 503
            assert f"refused by 127.0.0.1:{port}" in caught.value.message
        server = ModelServer()
        server.port = port
        server.start()
        try:
            # Nobody asks; the gateway finds out by itself.
            gateway.event("llm_server_back")
        finally:
            server.stop()
    assert gateway.told.count("llm_server_unreachable") == 1
    assert gateway.told.count("breaker_open") == 1
