"""Speaking with a network controller: a request and its reply, and the state it publishes."""

from __future__ import annotations

import queue
from collections.abc import Callable
from contextlib import suppress

from coadapt.asking import ask_patiently
from deploy.progress import typed
from swarm import keyspace
from swarm.errors import NetworkError, RefusedError, TransportError
from swarm.listening import hear
from swarm.messages import NetState, ShapeReply, ShapeRequest
from swarm.session import Session

STATE_S = 2.5
"""Two periods of `net/state` and some."""


def ask(session: Session, request: ShapeRequest) -> ShapeReply:
    """The controller's reply. Raises NetworkError: its refusal, or that there is no controller."""
    try:
        return ask_patiently(session, keyspace.net_shape(session.swarm), request, ShapeReply)
    except RefusedError as error:
        raise NetworkError(str(error)) from error
    except TransportError as error:
        raise NetworkError(
            f"no network controller answers in swarm {session.swarm!r} ({error}); see "
            f"`{typed('status', session.swarm)}` and `{typed('logs', session.swarm)}`"
        ) from error


def watch_state(session: Session) -> Callable[[], NetState | None]:
    """Listens to `net/state` from now on. The function that it returns waits for the first one
    and gives the newest, or None when none comes."""
    states: queue.SimpleQueue[NetState] = queue.SimpleQueue()
    hear(session, {NetState: states.put})

    def newest() -> NetState | None:
        found = None
        with suppress(queue.Empty):
            found = states.get(timeout=STATE_S)
            while True:
                found = states.get_nowait()
        return found

    return newest
