"""An answer as server-sent events, in OpenAI's chunks, while the model is at it."""

from __future__ import annotations

import asyncio
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import msgspec

from llm_gateway.http_chat import origin_of, usage_of
from llm_gateway.http_errors import of_gateway
from llm_gateway.model import Completion, Hear
from swarm.errors import GatewayError

DONE = b"data: [DONE]\n\n"


class AnswerStream:
    """One answer under way. Used on one event loop; close it."""

    def __init__(
        self, complete: Callable[[Hear], Awaitable[Completion]], model: str, *, include_usage: bool
    ) -> None:
        """`complete` begins the work at once; `model` is what chunks call the model."""
        self._heard: asyncio.Queue[str] = asyncio.Queue()
        self._work = asyncio.ensure_future(complete(self._heard.put_nowait))
        # So that whoever waits for words wakes up at the end.
        self._work.add_done_callback(lambda _: self._heard.put_nowait(""))
        self._head = {
            "id": f"chatcmpl-{uuid.uuid4().hex}",
            "object": "chat.completion.chunk",
            "created": int(time.time()),
            "model": model,
        }
        self._include_usage = include_usage
        self._first = ""

    async def begin(self) -> None:
        """Waits for the first words. Raises GatewayError, while a status can still be sent."""
        self._first = await self._heard.get()
        if self._work.done():
            self._work.result()

    async def events(self) -> AsyncIterator[bytes]:
        """Chunks, then `[DONE]`; an error after the first words is an event of its own."""
        yield self._chunk({"role": "assistant", "content": ""})
        told, words = "", self._first
        while True:
            if words:
                told += words
                yield self._chunk({"content": words})
            if self._work.done() and self._heard.empty():
                break
            words = await self._heard.get()
        try:
            done = self._work.result()
        except GatewayError as error:
            yield b"data: " + of_gateway(error).body() + b"\n\n"
            return
        if rest := done.text[len(told) :]:
            yield self._chunk({"content": rest})
        yield self._chunk({}, done.finish, coadapt=origin_of(done))
        if self._include_usage:
            yield _event(self._head | {"choices": [], "usage": usage_of(done)})
        yield DONE

    async def close(self) -> None:
        """Takes the work back, if it is not done."""
        self._work.cancel()
        await asyncio.gather(self._work, return_exceptions=True)

    def _chunk(self, delta: dict[str, str], finish: str | None = None, **more: Any) -> bytes:
        choice = {"index": 0, "delta": delta, "finish_reason": finish}
        usage = {"usage": None} if self._include_usage else {}
        return _event(self._head | {"choices": [choice]} | usage | more)


def _event(chunk: dict[str, Any]) -> bytes:
    return b"data: " + msgspec.json.encode(chunk) + b"\n\n"
