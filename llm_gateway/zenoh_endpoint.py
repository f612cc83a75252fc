"""The endpoint for egos and operators: queryables on the swarm's keys for decisions and wishes."""

from __future__ import annotations

import asyncio
import time
from concurrent.futures import CancelledError
from contextlib import suppress

from llm_gateway.gateway import Gateway
from llm_gateway.model import Job, Prompt
from llm_gateway.wish_reading import TrainedModel, WishReading
from swarm import keyspace
from swarm.errors import GatewayError, TransportError
from swarm.messages import DecideAnswer, DecideRequest, GatewayState, WishRequest
from swarm.session import Session

WORKERS = 256
"""As many as may wait, so that the gateway's order holds and not that of a thread pool."""
WISHES = 8
"""Operators that may wait at a time."""
SLACK_S = 1.0
ROLE = "ego"
"""Who may ask on the swarm's key."""
STATE_S = 1.0
"""Between two words of how the model stands."""


class ZenohEndpoint:
    """Hands requests of a session to the gateway's event loop, and tells how the model stands."""

    def __init__(
        self,
        gateway: Gateway,
        loop: asyncio.AbstractEventLoop,
        trained: TrainedModel | None = None,
    ) -> None:
        """`trained`: understands wishes; None: the gateway's model does."""
        self._gateway = gateway
        self._loop = loop
        self._wishes = WishReading(gateway, loop, trained)

    def open(self, session: Session) -> None:
        """Answers, and shows the gateway as alive."""
        session.serve(
            keyspace.llm_decide(session.swarm),
            DecideRequest,
            self.decide,
            workers=WORKERS,
            waiting=WORKERS,
        )
        session.serve(
            keyspace.llm_wish(session.swarm),
            WishRequest,
            self._wishes.answer,
            workers=WISHES,
            waiting=WISHES,
        )
        session.declare_gateway()
        asyncio.run_coroutine_threadsafe(self._tell(session), self._loop)

    async def _tell(self, session: Session) -> None:
        """Until the session or the loop closes."""
        key = keyspace.llm_state(session.swarm)
        with suppress(TransportError):
            while True:
                state = GatewayState(
                    model=self._gateway.model[:200], trouble=self._gateway.trouble[:300]
                )
                session.put(key, state)
                await asyncio.sleep(STATE_S)

    def decide(self, request: DecideRequest) -> DecideAnswer:
        """Answers one request, on a thread of the session. Raises GatewayError."""
        job = Job(
            Prompt(request.messages, request.schema, request.max_tokens),
            client=request.ego,
            deadline=time.monotonic() + request.deadline_s,
            fingerprint=request.fingerprint,
            role=ROLE,
        )
        completing = self._gateway.complete(job)
        try:
            waiting = asyncio.run_coroutine_threadsafe(completing, self._loop)
        except RuntimeError:
            completing.close()
            raise GatewayError("unavailable", "the gateway is closing") from None
        try:
            done = waiting.result(request.deadline_s + SLACK_S)
        except TimeoutError:
            waiting.cancel()
            raise GatewayError("expired", "the gateway was too busy") from None
        except CancelledError:
            raise GatewayError("unavailable", "the gateway is closing") from None
        return DecideAnswer(
            request=request.request,
            decision=done.text,
            source=done.source,
            hit=done.hit,
            model=done.model[:200],
            age_s=done.age_s,
            tokens=done.tokens,
            timings=done.timings,
        )
