"""A back end whose words a test decides, so that the gateway's own scheduling can be seen."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from prometheus_client import CollectorRegistry

from llm_gateway.cache import Cache
from llm_gateway.gateway import Gateway
from llm_gateway.metrics import GatewayMetrics
from llm_gateway.model import Hear, Job, Prompt, Reply
from swarm.log import make_logger
from swarm.messages import ChatMessage, LlmTokens

SCHEMA = json.dumps(
    {
        "type": "object",
        "properties": {"algorithm": {"enum": ["early", "late"]}},
        "required": ["algorithm"],
    }
)
EARLY = '{"algorithm":"early"}'
LONG_S = 20.0
Script = Callable[[Prompt, float], Awaitable[str]]


class Scripted:
    """Answers by `script(prompt, timeout_s)`; without one, as soon as `go` is set."""

    name = "scripted"

    def __init__(self, script: Script | None = None, parallel: int = 4) -> None:
        self.model = "scripted"
        self.parallel = parallel
        self.trouble = ""
        self.go = asyncio.Event()
        self.asked: list[str] = []
        """Last words of the prompts, in the order in which they came."""
        self.cancelled: list[str] = []
        self.running = self.most = 0
        self.changed = asyncio.Event()
        self._script = script

    async def start(self) -> None:
        pass

    async def close(self) -> None:
        pass

    async def complete(self, prompt: Prompt, timeout_s: float, hear: Hear | None = None) -> Reply:
        words = prompt.messages[-1].content
        self.asked.append(words)
        self.running += 1
        self.most = max(self.most, self.running)
        self.changed.set()
        try:
            if self._script is not None:
                return Reply(await self._script(prompt, timeout_s), LlmTokens(prompt=9, output=2))
            await self.go.wait()
            return Reply(EARLY, LlmTokens(prompt=9, output=2))
        except asyncio.CancelledError:
            self.cancelled.append(words)
            raise
        finally:
            self.running -= 1
            self.changed.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        """Waits for a state that calls bring about."""
        async with asyncio.timeout(LONG_S):
            while not condition():
                self.changed.clear()
                await self.changed.wait()


class Rig:
    """A gateway that runs, and what it counts."""

    def __init__(self, backend: Scripted, cache: Path | None, **options: Any) -> None:
        self.registry = CollectorRegistry()
        self.backend = backend
        metrics = GatewayMetrics(self.registry)
        log = make_logger("test", level="error")
        cached = {name: options.pop(name) for name in ("ttl_s", "entries") if name in options}
        self.cache = Cache(cache, metrics, log, **cached)
        options.setdefault("window_ms", 0.0)
        self.gateway = Gateway(backend, self.cache, metrics, log, **options)

    def count(self, name: str, **labels: str) -> float:
        return self.registry.get_sample_value(f"coadapt_llm_{name}", labels) or 0.0


@asynccontextmanager
async def rig(backend: Scripted, cache: Path | None = None, **options: Any) -> AsyncIterator[Rig]:
    """A gateway on the running loop, closed afterwards."""
    made = Rig(backend, cache, **options)
    await made.gateway.start()
    try:
        yield made
    finally:
        await made.gateway.close()


def job(
    words: str = "which?",
    *,
    client: str = "E1",
    within_s: float = LONG_S,
    schema: str = SCHEMA,
    fingerprint: str = "",
    role: str = "",
    system: str = "",
) -> Job:
    """A request whose deadline is `within_s` from now."""
    said = (ChatMessage("system", system),) if system else ()
    return Job(
        Prompt((*said, ChatMessage("user", words)), schema),
        client,
        time.monotonic() + within_s,
        fingerprint,
        role,
    )
