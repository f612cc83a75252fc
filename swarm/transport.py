"""Opening and closing Zenoh sessions."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Protocol

import zenoh

from swarm.errors import TransportError
from swarm.reaching import why_not
from swarm.zenoh_config import check_identity, nested, shown_identity

RETRY_S = 0.5
FIRST_TELL_S, TELL_S = 2.0, 10.0
"""When, and how often, a process that waits for its router says why."""
POLL_S = 0.1

CLOSE_S = 1.2
"""Under loss Zenoh may hold a closing session for ten seconds; a process must not wait for it."""


class Entity(Protocol):
    """What Zenoh declares: a subscriber, a queryable or a liveliness token."""

    def undeclare(self) -> Any:
        """Withdraws it."""


def open_zenoh(
    config: dict[str, Any],
    *,
    timeout_s: float | None = None,
    stop: threading.Event | None = None,
    on_wait: Callable[[str], object] | None = None,
) -> zenoh.Session:
    """Opens a session; a client tries again every half second until its router is there.

    Args:
        config: settings by Zenoh's configuration path.
        timeout_s: give up after this long; None tries until `stop` is set.
        stop: ends the attempts.
        on_wait: hears every TELL_S, on a thread of its own, why the router cannot be reached.

    Raises:
        TransportError: the session could not be opened in time, or `stop` was set first.
        IdentityError: this process has no certificate that it could show.
    """
    stop = stop or threading.Event()
    deadline = math.inf if timeout_s is None else time.monotonic() + timeout_s
    where = config.get("listen/endpoints") or config.get("connect/endpoints")
    failure: zenoh.ZError | None = None
    waiting = _Waiting(config, on_wait)
    while True:
        attempt: Future[zenoh.Session] = Future()
        # On a thread of its own: where packets vanish, an attempt lasts as long as TCP tries.
        threading.Thread(target=_open, args=(config, attempt), name="open", daemon=True).start()
        try:
            return _wait(attempt, deadline, stop, waiting)
        except zenoh.ZError as error:
            _check_identity(config)
            failure = error
            if config["mode"] != "client" or time.monotonic() >= deadline:
                raise _cannot(where, failure, config) from error
        except TimeoutError as error:
            if not stop.is_set() and failure is not None:
                # How an earlier attempt ended says more than that this one has not.
                raise _cannot(where, failure, config) from failure
            if not stop.is_set():
                raise TransportError(f"no answer from {where} within {timeout_s} s") from error
        if stop.wait(RETRY_S):
            raise TransportError(f"stopped before {where} could be reached")


class _Waiting:
    """Tells now and then why a router cannot be reached."""

    def __init__(self, config: dict[str, Any], on_wait: Callable[[str], object] | None) -> None:
        self._config = config
        self._on_wait = on_wait
        self._due = time.monotonic() + FIRST_TELL_S

    def look(self) -> None:
        """Tells, where that is due; takes no time itself."""
        if self._on_wait is None or time.monotonic() < self._due:
            return
        self._due = time.monotonic() + TELL_S
        threading.Thread(target=self._tell, name="reaching", daemon=True).start()

    def _tell(self) -> None:
        assert self._on_wait is not None
        self._on_wait(_why_not(self._config) or "it does not answer")


def _why_not(config: dict[str, Any]) -> str:
    """Why a client's router cannot be reached, as far as that can be found out."""
    connect = config.get("connect/endpoints")
    if config["mode"] != "client" or not connect or not isinstance(connect[0], dict):
        return ""
    return why_not(connect[0]["locators"][0], shown_identity(config))


def _cannot(where: object, failure: zenoh.ZError, config: dict[str, Any]) -> TransportError:
    why = _why_not(config)
    told = f"{failure}: {why}" if why else f"{failure}{_hint(config)}"
    return TransportError(f"cannot open a Zenoh session at {where}: {told}")


def _hint(config: dict[str, Any]) -> str:
    """What else may be wrong where a router does not take a client: it does not say."""
    if config["mode"] != "client":
        return ""
    identity = shown_identity(config)
    if identity is not None:
        return (
            f". Where the router runs: {identity.ca} may be another swarm's authority, or the "
            "router's certificate of another address"
        )
    if "tcp/" in str(config["connect/endpoints"]):
        return ". Where the router runs: a secure one wants tls/HOST:PORT#identity=FOLDER"
    return ""


def _check_identity(config: dict[str, Any]) -> None:
    """Raises IdentityError where that is why a session could not be opened."""
    identity = shown_identity(config)
    if identity is not None:
        check_identity(identity)


def close_zenoh(
    session: zenoh.Session, entities: Iterable[Entity] = (), patience_s: float = CLOSE_S
) -> None:
    """Withdraws the entities and closes; waits no longer than `patience_s`, and lets it go on.

    Queryables go with the session: where two sessions serve one key and one of them withdraws it,
    a router of Zenoh 1.10 sends the questions to neither until somebody else connects.
    """

    def work() -> None:
        # What is closed already needs no closing.
        with suppress(zenoh.ZError):
            for entity in entities:
                if not isinstance(entity, zenoh.Queryable):
                    entity.undeclare()
            session.close()  # type: ignore[no-untyped-call]

    thread = threading.Thread(target=work, name="close", daemon=True)
    thread.start()
    thread.join(patience_s)


def _open(config: dict[str, Any], attempt: Future[zenoh.Session]) -> None:
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(nested(config))))
    except zenoh.ZError as error:
        if attempt.set_running_or_notify_cancel():
            attempt.set_exception(error)
        return
    if attempt.set_running_or_notify_cancel():
        attempt.set_result(session)
    else:
        session.close()  # type: ignore[no-untyped-call]


def _wait(
    attempt: Future[zenoh.Session], deadline: float, stop: threading.Event, waiting: _Waiting
) -> zenoh.Session:
    """The session of an attempt. Raises ZError when it fails, TimeoutError when it is given up."""
    while True:
        waiting.look()
        try:
            return attempt.result(POLL_S)
        except TimeoutError:
            if (stop.is_set() or time.monotonic() >= deadline) and attempt.cancel():
                raise
