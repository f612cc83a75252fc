"""Egos that each have one request under way at all times, over Zenoh or over HTTP."""

from __future__ import annotations

import asyncio
import itertools
import json
import time
from collections.abc import Awaitable, Callable
from typing import Any

import aiohttp

from research.benchmarks.fixed_model import MODEL, SCHEMA
from swarm import keyspace
from swarm.messages import ChatMessage, DecideAnswer, DecideRequest
from swarm.session import Session
from swarm.traffic import TrafficClass

DEADLINE_S = 30.0
SYSTEM = "Choose who takes part, and how. " * 60
"""With the scene about as long as a real prompt for six robots, 3,000 characters."""
_numbers = itertools.count()

Ask = Callable[[int, str], Awaitable[dict[str, Any]]]
"""Asks as one ego with a scene; the model's answer."""


def fresh_scene() -> str:
    """No cache knows it."""
    return f"Scene {next(_numbers)}. " + "R1 sees 12 objects. " * 50


async def in_turn(ask: Ask, egos: int, rounds: int, model_s: float) -> list[float]:
    """Overhead of each request in ms: its time less the model's. The first round is not counted.

    Egos begin spread over the model's time, as they do where each has its own clock.
    """

    async def ego(number: int) -> list[float]:
        await asyncio.sleep(model_s * number / egos)
        found = []
        for _ in range(rounds + 1):
            scene = fresh_scene()
            begun = time.perf_counter()
            answer = await ask(number, scene)
            found.append((time.perf_counter() - begun) * 1e3 - answer["model_ms"])
        return found[1:]

    return list(itertools.chain(*await asyncio.gather(*map(ego, range(egos)))))


def over_zenoh(session: Session) -> Ask:
    """Asks the gateway as an ego does."""
    key = keyspace.llm_decide(session.swarm)
    schema = json.dumps(SCHEMA)

    async def ask(number: int, scene: str) -> dict[str, Any]:
        request = DecideRequest(
            request=number,
            ego=f"R{number}",
            messages=(ChatMessage("system", SYSTEM), ChatMessage("user", scene)),
            schema=schema,
            deadline_s=DEADLINE_S,
        )
        future = session.ask(
            key, request, DecideAnswer, timeout_s=DEADLINE_S, traffic=TrafficClass.CONTROL
        )
        answer = (await asyncio.wrap_future(future)).message
        found: dict[str, Any] = json.loads(answer.decision)
        return found | {"source": answer.source}

    return ask


def over_http(client: aiohttp.ClientSession, url: str) -> Ask:
    """Asks whatever speaks OpenAI's chat completions there."""
    asked = {"type": "json_schema", "json_schema": {"name": "answer", "schema": SCHEMA}}

    async def ask(number: int, scene: str) -> dict[str, Any]:
        messages = [{"role": "system", "content": SYSTEM}, {"role": "user", "content": scene}]
        body = {"model": MODEL, "messages": messages, "response_format": asked, "max_tokens": 256}
        headers = {"X-CoAdapt-Client": f"R{number}"}
        async with client.post(
            f"{url}/v1/chat/completions", json=body, headers=headers
        ) as response:
            answer = await response.json()
            if response.status != 200:
                raise RuntimeError(f"{url} answered {response.status}: {answer}")
            found: dict[str, Any] = json.loads(answer["choices"][0]["message"]["content"])
            return found

    return ask
