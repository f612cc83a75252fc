"""Understands wishes for the endpoints, by the gateway's own model."""

from __future__ import annotations

import asyncio
import time
from concurrent.futures import CancelledError
from dataclasses import dataclass
from datetime import datetime

from llm_gateway.model import Completer, Job, Prompt
from llm_gateway.wishes import understand
from swarm.errors import GatewayError
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

    def read(self, prompt: Prompt) -> str:
        """Its answer. Raises GatewayError."""
        job = Job(prompt, client=self.client, deadline=self.deadline, fingerprint="", role=ROLE)
        completing = self.gateway.complete(job)
        try:
            waiting = asyncio.run_coroutine_threadsafe(completing, self.loop)
        except RuntimeError:
            completing.close()
            raise GatewayError("unavailable", "the gateway is closing") from None
        try:
            return waiting.result(max(0.0, self.deadline - time.monotonic()) + SLACK_S).text
        except TimeoutError:
            waiting.cancel()
            raise GatewayError("expired", "the gateway was too busy") from None
        except CancelledError:
            raise GatewayError("unavailable", "the gateway is closing") from None


class WishReading:
    """Answers requests of both endpoints, each on a thread of its asker."""

    def __init__(self, gateway: Completer, loop: asyncio.AbstractEventLoop) -> None:
        self._gateway = gateway
        self._loop = loop

    def answer(self, request: WishRequest) -> WishAnswer:
        """What a wish means. Raises GatewayError where the model does not answer, or the time of
        the request is none."""
        reader = GatewayReader(
            self._gateway,
            self._loop,
            client=request.operator or ROLE,
            deadline=time.monotonic() + request.deadline_s,
        )
        understood = understand(request.wish, request.site, _time(request.now), reader)
        return WishAnswer(request=request.request, understood=understood)


def _time(text: str) -> datetime:
    try:
        now = datetime.fromisoformat(text)
    except ValueError:
        raise GatewayError("invalid", f"now {text!r} is not a time; allowed: ISO 8601") from None
    if now.tzinfo is None:
        raise GatewayError("invalid", f"now {text!r} has no time zone")
    return now
