"""Asking a process of a swarm, which may have started a moment ago."""

from __future__ import annotations

import time
from typing import TypeVar

from swarm.errors import RefusedError, TransportError
from swarm.messages import Message
from swarm.session import Session
from swarm.traffic import TrafficClass

M = TypeVar("M", bound=Message)
ANSWER_S = 15.0
FIND_S = 5.0
"""A process that has just started may not be known to the router yet."""
AGAIN_S = 0.2


def ask_patiently(session: Session, key: str, request: Message, kind: type[M]) -> M:
    """The answer of the one queryable on a key.

    Raises RefusedError with the reason alone when it refuses, TransportError when nobody answers.
    """
    until = time.monotonic() + FIND_S
    while True:
        future = session.ask(key, request, kind, timeout_s=ANSWER_S, traffic=TrafficClass.CONTROL)
        try:
            return future.result().message
        except RefusedError as error:
            raise RefusedError(error.reason, code=error.code) from error
        except TransportError:
            # Not again after a long wait: it may have heard of it.
            if time.monotonic() > until:
                raise
        time.sleep(AGAIN_S)
