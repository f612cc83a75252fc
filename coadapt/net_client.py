"""Speaking with the network controllers of a swarm: requests, replies, and what they publish."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

from coadapt.asking import ask_patiently
from deploy.progress import typed
from swarm import keyspace
from swarm.controllers import Controllers, means_all, of
from swarm.errors import NetworkError, RefusedError, TransportError
from swarm.listening import hear
from swarm.messages import LinkState, NetState, ShapeReply, ShapeRequest
from swarm.session import Session

GATHER_S = 1.5
"""Each controller tells its state once a second: all that are there have by then."""
STATE_S = 2.5
"""How long the first state is waited for."""


def ask(session: Session, request: ShapeRequest, controller: str = "") -> ShapeReply:
    """One controller's reply, by its name. Raises NetworkError: its refusal, or that there is no
    such controller."""
    key = keyspace.net_shape(session.swarm, controller)
    try:
        return ask_patiently(session, key, request, ShapeReply)
    except RefusedError as error:
        raise NetworkError(f"{of(controller)}{error}") from error
    except TransportError as error:
        raise NetworkError(
            f"{of(controller)}no network controller answers in swarm {session.swarm!r} ({error}); "
            f"see `{typed('status', session.swarm)}` and `{typed('logs', session.swarm)}`"
        ) from error


class NetClient:
    """The controllers of one swarm, from the moment on when it is made."""

    def __init__(self, session: Session, ego: str) -> None:
        """`ego`: whose link downwards is the cell."""
        self._session = session
        self._ego = ego
        self._controllers = Controllers()
        self._changed = threading.Condition()
        self._since = time.monotonic()
        hear(session, {NetState: self._on_state})

    def ask(self, request: ShapeRequest) -> Mapping[str, ShapeReply]:
        """The replies by controller: of the one that has the link, of all where all links are
        meant. Raises NetworkError: a refusal, or that there is no controller."""
        robot = request.robot or self._ego
        self._wait(GATHER_S, lambda: not means_all(request) and self._of(robot) is not None)
        with self._changed:
            requests = self._controllers.addressees(request, self._ego, time.monotonic())
        return {name: ask(self._session, each, name) for name, each in requests.items()}

    def states(self) -> Mapping[str, NetState]:
        """What each controller said last; see `Controllers.present`."""
        with self._changed:
            return self._controllers.present(time.monotonic())

    def links(self) -> tuple[LinkState, ...]:
        """The state of all shaped links; waits for the first word of a controller."""
        self._wait(STATE_S, lambda: bool(self.states()))
        with self._changed:
            return self._controllers.links(time.monotonic())

    def _of(self, robot: str) -> str | None:
        with self._changed:
            return self._controllers.of(robot, time.monotonic())

    def _on_state(self, state: NetState) -> None:
        with self._changed:
            self._controllers.take(state, time.monotonic())
            self._changed.notify_all()

    def _wait(self, seconds: float, enough: Callable[[], bool] = lambda: False) -> None:
        """Until it is `enough`, or so long after the first moment."""
        with self._changed:
            left_s = self._since + seconds - time.monotonic()
            self._changed.wait_for(enough, max(0.0, left_s))
