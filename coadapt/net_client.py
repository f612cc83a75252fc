"""Speaking with a network controller: a request and its reply, and the state it publishes."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from contextlib import suppress

from swarm import keyspace
from swarm.errors import NetworkError, RefusedError, TransportError
from swarm.messages import NetState, ShapeReply, ShapeRequest
from swarm.session import Session
from swarm.traffic import TrafficClass

ANSWER_S = 15.0
FIND_S = 5.0
"""A controller that has just started may not be known to the router yet."""
AGAIN_S = 0.2
STATE_S = 2.5
"""Two periods of `net/state` and some."""


def ask(session: Session, request: ShapeRequest) -> ShapeReply:
    """The controller's reply. Raises NetworkError: its refusal, or that there is no controller."""
    until = time.monotonic() + FIND_S
    while True:
        future = session.ask(
            keyspace.net_shape(session.swarm),
            request,
            ShapeReply,
            timeout_s=ANSWER_S,
            traffic=TrafficClass.CONTROL,
        )
        try:
            return future.result().message
        except RefusedError as error:
            raise NetworkError(str(error).partition(" refused: ")[2]) from error
        except TransportError as error:
            # Not again after a long wait: the controller may have heard of it.
            if time.monotonic() > until:
                raise NetworkError(
                    f"no network controller answers in swarm {session.swarm!r} ({error}); see "
                    "`coadapt status` and `coadapt logs controller`"
                ) from error
        time.sleep(AGAIN_S)


def watch_state(session: Session) -> Callable[[], NetState | None]:
    """Listens to `net/state` from now on. The function that it returns waits for the first one
    and gives the newest, or None when none comes."""
    states: queue.SimpleQueue[NetState] = queue.SimpleQueue()
    session.subscribe(keyspace.net_state(session.swarm), NetState, lambda s, _: states.put(s))

    def newest() -> NetState | None:
        found = None
        with suppress(queue.Empty):
            found = states.get(timeout=STATE_S)
            while True:
                found = states.get_nowait()
        return found

    return newest
