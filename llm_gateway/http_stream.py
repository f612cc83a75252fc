"""An answer as server-sent events, in OpenAI's chunks, while the model is at it."""

from __future__ import annotations

import asyncio
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable

import msgspec
from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from llm_gateway.http_errors import of_gateway
from llm_gateway.http_messages import ChatChunk, ChunkChoice, Delta, Origin, Usage
from llm_gateway.http_operations import DONE
from llm_gateway.model import Completion, Finish, Hear
from swarm.errors import GatewayError

_DONE = f"data: {DONE}\n\n".encode()


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
        self._head = ChatChunk(
            id=f"chatcmpl-{uuid.uuid4().hex}", created=int(time.time()), model=model, choices=()
        )
        self._include_usage = include_usage
        self._first = ""

    async def begin(self) -> None:
        """Waits for the first words. Raises GatewayError, while a status can still be sent."""
        self._first = await self._heard.get()
        if self._work.done():
            self._work.result()

    async def events(self) -> AsyncIterator[bytes]:
        """Chunks, then `[DONE]`; an error after the first words is an event of its own."""
        yield self._chunk(Delta(role="assistant", content=""))
        told, words = "", self._first
        while True:
            if words:
                told += words
                yield self._chunk(Delta(content=words))
            if self._work.done() and self._heard.empty():
                break
            words = await self._heard.get()
        try:
            done = self._work.result()
        except GatewayError as error:
            yield b"data: " + of_gateway(error).body() + b"\n\n"
            return
        if rest := done.text[len(told) :]:
            yield self._chunk(Delta(content=rest))
        yield self._chunk(Delta(), done.finish, Origin.of(done))
        if self._include_usage:
            yield _event(replace(self._head, usage=Usage.of(done)))
        yield _DONE

    async def close(self) -> None:
        """Takes the work back, if it is not done."""
        self._work.cancel()
        await asyncio.gather(self._work, return_exceptions=True)

    def _chunk(
        self, delta: Delta, finish: Finish | None = None, origin: Origin | UnsetType = UNSET
    ) -> bytes:
        usage = None if self._include_usage else UNSET
        choices = (ChunkChoice(0, delta, finish),)
        return _event(replace(self._head, choices=choices, usage=usage, coadapt=origin))


def _event(chunk: ChatChunk) -> bytes:
    return b"data: " + msgspec.json.encode(chunk) + b"\n\n"
