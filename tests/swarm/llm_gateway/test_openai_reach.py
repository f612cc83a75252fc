"""What a model server that cannot be reached is called, and how that ends."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from llm_gateway.backends.openai import OpenAi
from llm_gateway.backends.openai_reach import Reach
from llm_gateway.model import Prompt
from swarm.errors import GatewayError
from swarm.log import make_logger
from swarm.messages import ChatMessage
from tests.support.free_ports import free_port
from tests.support.model_server import refuses, resets, says, serving_model, streams

LOG = make_logger("test", level="critical")
PROMPT = Prompt((ChatMessage("user", "Say something."),), max_tokens=8)
WAIT_S = 20.0


def asking(url: str, work: Any) -> Any:
    """Runs `work(backend)` with a back end that has started."""

    async def whole() -> Any:
        backend = OpenAi(url, "m", "", 4, LOG)
        await backend.start()
        try:
            return await work(backend)
        finally:
            await backend.close()

    return asyncio.run(whole())


async def until(holds: Any) -> None:
    async with asyncio.timeout(WAIT_S):
        while not holds():
            await asyncio.sleep(0.02)


@pytest.mark.parametrize(
    ("host", "said"),
    [("127.0.0.1", "refused by 127.0.0.1:{port}"), ("nobody.invalid", "no host is called nobody")],
)
def test_why_a_server_cannot_be_reached_is_said(host: str, said: str) -> None:
    port = free_port()

    async def ask(backend: OpenAi) -> str:
        with pytest.raises(GatewayError, match=r"unavailable: .* cannot be reached: "):
            await backend.complete(PROMPT, WAIT_S)
        return backend.trouble

    assert said.format(port=port) in asking(f"http://{host}:{port}", ask)


def test_one_broken_connection_is_no_trouble_and_a_server_that_has_gone_is_found_out() -> None:
    async def ask(backend: OpenAi) -> None:
        for stop in (False, True):
            with pytest.raises(GatewayError, match="unavailable"):
                await backend.complete(PROMPT, WAIT_S)
            assert not backend.trouble
            if stop:
                await asyncio.to_thread(server.stop)
                # Nobody asks any more.
                await until(lambda: backend.trouble.startswith("refused by "))
            else:
                await asyncio.sleep(1.0)
                assert not backend.trouble

    with serving_model(resets(), resets()) as server:
        asking(server.url, ask)


def test_what_a_server_does_not_know_is_left_out_but_not_chance() -> None:
    asked = Prompt(PROMPT.messages, max_tokens=8, stop=("END",), temperature=0.5)

    async def ask(backend: OpenAi) -> None:
        heard: list[str] = []
        reply = await backend.complete(asked, WAIT_S, heard.append)
        assert (reply.text, "".join(heard)) == ("one END two", "one END two")
        assert (reply.tokens.prompt, reply.finish) == (11, "length")
        with pytest.raises(GatewayError, match="Only the default"):
            await backend.complete(asked, WAIT_S)

    plan = [
        refuses(400, "Unknown", param="stop"),
        refuses(400, "Unknown", param="stream_options"),
        streams("one ", "END two", finish="length"),
        refuses(400, "Only the default (1) value is supported.", param="temperature"),
    ]
    with serving_model(*plan) as server:
        asking(server.url, ask)
        bodies = [server.next().body for _ in plan]
    assert "stop" in bodies[0]
    assert not {"stop", "stream_options"} & set(bodies[2])
    assert [body["temperature"] for body in bodies] == [0.5] * 4


@pytest.mark.parametrize("param", ["max_tokens", "temperature", "stop"])
def test_prompts_under_way_together_all_learn_from_the_first_refusal(param: str) -> None:
    asked = Prompt(PROMPT.messages, max_tokens=8, stop=("END",))
    together = 3
    all_in = asyncio.Barrier(together)

    async def refused(*connection: Any) -> None:
        # Each is written before any of them is refused.
        await all_in.wait()
        await refuses(400, "Unknown", param=param)(*connection)

    async def ask(backend: OpenAi) -> list[str]:
        replies = await asyncio.gather(*(backend.complete(asked, WAIT_S) for _ in range(together)))
        return [reply.text for reply in replies]

    with serving_model(*[refused] * together) as server:
        server.otherwise = says("well")
        assert asking(server.url, ask) == ["well"] * together
        bodies = [server.next().body for _ in range(2 * together)]
    assert [param in body for body in bodies] == [True] * together + [False] * together


def test_nobody_tries_a_server_once_the_back_end_is_closed() -> None:
    async def story() -> int:
        tried = 0

        async def probe() -> None:
            nonlocal tried
            tried += 1

        reach = Reach("http://127.0.0.1:9", probe, LOG)
        await reach.close()
        # Requests that were under way when it was closed.
        reach.broke_off("reset")
        reach.lost("refused")
        return len(asyncio.all_tasks()) + tried

    assert asyncio.run(story()) == 1


def test_a_server_that_does_not_stream_answers_at_once() -> None:
    async def ask(backend: OpenAi) -> None:
        heard: list[str] = []
        reply = await backend.complete(PROMPT, WAIT_S, heard.append)
        assert (reply.text, reply.finish, heard) == ("whole", "length", [])

    with serving_model(says("whole", finish="length")) as server:
        asking(server.url, ask)
