"""The embedded model with chance, stop sequences and an end: the real model answers."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from openai import OpenAI

from llm_gateway.backends.llamacpp.client import LlamaCpp
from llm_gateway.backends.llamacpp.engine import Engine
from llm_gateway.model import Prompt
from swarm.log import make_logger
from swarm.messages import ChatMessage
from tests.support.embedded_model import CONTEXT, SCHEMA, SEQUENCES, ask, run
from tests.support.gateway_process import gateway_process

pytestmark = pytest.mark.model

pytest_plugins = ("tests.support.embedded_fixtures",)

STORY = Prompt((ChatMessage("user", "Tell a story of a robot."),), max_tokens=24)
CHANCE = replace(STORY, temperature=1.0, seed=1)


def test_equal_seeds_draw_alike_and_others_do_not(engine: Engine) -> None:
    first = run(engine, CHANCE)[0].text
    assert run(engine, CHANCE)[0].text == first
    others = {run(engine, replace(CHANCE, seed=seed))[0].text for seed in (2, 3, -1)}
    assert len(others | {first}) == 4
    unseeded = {run(engine, replace(CHANCE, seed=None))[0].text for _ in range(3)}
    assert len(unseeded) == 3


def test_without_chance_the_likeliest_words_come(engine: Engine) -> None:
    greedy = run(engine, STORY)[0].text
    assert run(engine, replace(STORY, seed=5))[0].text == greedy
    # Of the likeliest words only the very likeliest remain.
    assert run(engine, replace(CHANCE, top_p=0.0))[0].text == greedy
    for cold in (1e-3, 1e-307):
        assert run(engine, replace(CHANCE, temperature=cold))[0].text == greedy


def test_chance_keeps_to_the_schema(engine: Engine) -> None:
    texts = set()
    for seed in range(4):
        asked = replace(ask("Link: 5 Mbit/s", max_tokens=160), temperature=1.5, seed=seed)
        decided = json.loads(run(engine, asked)[0].text)
        assert list(decided) == list(json.loads(SCHEMA)["properties"])
        assert "R2" in decided["participants"]
        texts.add(json.dumps(decided))
    assert len(texts) > 1


def test_an_answer_ends_at_its_length_or_its_stop_sequence(engine: Engine) -> None:
    whole = run(engine, STORY)[0]
    assert (whole.finish, whole.tokens.output) == ("length", 24)
    words = whole.text.split()
    stop = " ".join(words[3:5])
    stopped = run(engine, replace(STORY, stop=(stop, "never said")))[0]
    assert stopped.finish == "stop"
    assert stopped.tokens.output < 24
    assert stopped.text.index(stop) <= whole.text.index(stop)
    short = Prompt((ChatMessage("user", "Say yes."),), '{"enum": ["yes"]}', 24)
    assert run(engine, short)[0].finish == "stop"


def test_words_are_told_while_they_come(model_file: Path) -> None:
    heard: list[str] = []

    async def answer() -> str:
        log = make_logger("test", level="critical")
        backend = LlamaCpp(model_file, SEQUENCES, CONTEXT, 2, log)
        await backend.start()
        try:
            return (await backend.complete(CHANCE, 60, heard.append)).text
        finally:
            await backend.close()

    text = asyncio.run(answer())
    assert len(heard) > 10
    # The last words come with the answer itself.
    assert text.startswith("".join(heard))


@pytest.mark.stumble(
    "seed and temperature change nothing with the embedded model",
    command="make up LLM=embedded; curl 127.0.0.1:9106/v1/chat/completions -d '{\"seed\": 1, ...}'",
)
def test_openais_client_gets_chance_stops_and_streams_of_the_embedded_model(
    model_file: Path,
) -> None:
    with gateway_process(
        LLM_BACKEND="llamacpp", LLM_MODEL=str(model_file), LLM_CONTEXT="512"
    ) as gateway:
        client = OpenAI(base_url=gateway.url, api_key="none", max_retries=0, timeout=120)

        def say(**fields: Any) -> Any:
            asked: Any = [{"role": "user", "content": "Tell a story of a robot."}]
            return client.chat.completions.create(
                **({"model": "default", "messages": asked, "max_tokens": 16} | fields)
            )

        plain = say().choices[0]
        assert plain.finish_reason == "length"
        texts = {say(temperature=1, seed=seed).choices[0].message.content for seed in (1, 1, 2)}
        assert len(texts) == 2
        assert len({say(temperature=1).choices[0].message.content for _ in range(3)}) == 3
        stop = plain.message.content.split()[2]
        stopped = say(stop=stop).choices[0]
        assert stopped.finish_reason == "stop"
        assert stopped.message.content == plain.message.content.partition(stop)[0]
        chunks = list(say(temperature=1, seed=3, stream=True))
        words = [c.choices[0].delta.content for c in chunks if c.choices[0].delta.content]
        assert len(words) > 5
        assert "".join(words) == say(temperature=1, seed=3, top_p=1).choices[0].message.content
        assert chunks[-1].choices[0].finish_reason == "length"
