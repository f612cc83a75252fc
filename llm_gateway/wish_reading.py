"""Understands wishes for the endpoints, by the gateway's own model."""

from __future__ import annotations

import asyncio
import time
from concurrent.futures import CancelledError
from dataclasses import dataclass
from datetime import datetime

from llm_gateway.backends.base import Backend
from llm_gateway.model import Completer, Job, Prompt, Reply
from llm_gateway.wishes import Reader, understand
from llm_gateway.wishes.readers import BackendReader
from swarm.errors import GatewayError, SettingError
from swarm.messages import WishAnswer, WishRequest

SLACK_S = 1.0
ROLE = "operator"
"""Whose answers the cache keeps apart."""


@dataclass(frozen=True, slots=True)
class GatewayReader:
    """Asks the gateway's model, as any other client does. Implements `llm_gateway.wishes.Reader`;
    not for the loop's own thread."""

    gateway: Completer
    loop: asyncio.AbstractEventLoop
    client: str
    deadline: float
    """`time.monotonic()` seconds."""
    trained: bool = False

    @property
    def model(self) -> str:
        """The gateway's."""
        return self.gateway.model

    def read(self, prompt: Prompt) -> Reply:
        """Its answer. Raises GatewayError."""
        job = Job(prompt, client=self.client, deadline=self.deadline, fingerprint="", role=ROLE)
        completing = self.gateway.complete(job)
        try:
            waiting = asyncio.run_coroutine_threadsafe(completing, self.loop)
        except RuntimeError:
            completing.close()
            raise GatewayError("unavailable", "the gateway is closing") from None
        try:
            done = waiting.result(max(0.0, self.deadline - time.monotonic()) + SLACK_S)
            return Reply(done.text)
        except TimeoutError:
            waiting.cancel()
            raise GatewayError("expired", "the gateway was too busy") from None
        except CancelledError:
            raise GatewayError("unavailable", "the gateway is closing") from None


class TrainedModel:
    """A back end that has learnt to understand wishes, started when the first one comes."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._started: asyncio.Task[None] | None = None

    def reader(self, loop: asyncio.AbstractEventLoop, timeout_s: float) -> Reader:
        """Asks it; not for the loop's own thread. Raises GatewayError where it does not start in
        time."""
        try:
            asyncio.run_coroutine_threadsafe(self._start(), loop).result(timeout_s)
        except (TimeoutError, SettingError) as error:
            why = f"the model of wishes does not start: {error or 'it takes too long'}"
            raise GatewayError("unavailable", why) from None
        return BackendReader(self._backend, loop, trained=True, timeout_s=timeout_s)

    async def close(self) -> None:
        """Ends what was started."""
        if self._started is not None:
            await self._backend.close()

    async def _start(self) -> None:
        if self._started is None or (self._started.done() and self._started.exception()):
            self._started = asyncio.ensure_future(self._backend.start())
        await asyncio.shield(self._started)


class WishReading:
    """Answers requests of both endpoints, each on a thread of its asker."""

    def __init__(
        self,
        gateway: Completer,
        loop: asyncio.AbstractEventLoop,
        trained: TrainedModel | None = None,
    ) -> None:
        """`trained`: a model that has learnt to understand wishes; None asks the gateway's."""
        self._gateway = gateway
        self._loop = loop
        self._trained = trained

    def answer(self, request: WishRequest) -> WishAnswer:
        """What a wish means. Raises GatewayError where the model does not answer, or the time of
        the request is none."""
        now = said_at(request.now)
        understood = understand(request.wish, request.site, now, self._reader(request))
        return WishAnswer(request=request.request, understood=understood)

    def _reader(self, request: WishRequest) -> Reader:
        if self._trained is not None:
            return self._trained.reader(self._loop, request.deadline_s)
        return GatewayReader(
            self._gateway,
            self._loop,
            client=request.operator or ROLE,
            deadline=time.monotonic() + request.deadline_s,
        )


def said_at(text: str) -> datetime:
    """The time of a wish. Raises GatewayError `invalid` for one that is none or has no zone."""
    try:
        now = datetime.fromisoformat(text)
    except ValueError:
        raise GatewayError("invalid", f"now {text!r} is not a time; allowed: ISO 8601") from None
    if now.tzinfo is None:
        raise GatewayError("invalid", f"now {text!r} has no time zone")
    return now
