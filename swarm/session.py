"""A swarm's session: typed messages over Zenoh, with traffic classes and validation at the edge.

Handlers given to `subscribe` and `watch_alive` run on Zenoh's own threads: they must return
quickly and must not call the session. Queryable handlers and answers run on this session's
threads and may take their time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, TypeVar

import zenoh
from prometheus_client import CollectorRegistry, Counter, Gauge

from swarm import keyspace, zenoh_config
from swarm.asking import Answer, Question
from swarm.connection import Connection
from swarm.credit import Window
from swarm.errors import CoAdaptError, KeyspaceError, MessageError, TransportError
from swarm.log import Logger, make_logger
from swarm.messages import Message, NetState, decode, encode
from swarm.metrics import start_at_zero
from swarm.serving import MAX_WAITING_QUERIES, Server
from swarm.traffic import TrafficClass
from swarm.trust.renewal import Renewal, last_issued

__all__ = ["MAX_WAITING_QUERIES", "Answer", "Session"]

M = TypeVar("M", bound=Message)
MAX_REMEMBERED_SENDERS = 256
MAX_ALIVE = 100_000
"""Robots that `alive` can tell of; the places are taken only as they come."""


class Session:
    """One process's connection to its swarm. Use as a context manager, or call `close`."""

    def __init__(
        self,
        router: str,
        swarm: str,
        *,
        registry: CollectorRegistry | None = None,
        log: Logger | None = None,
        timeout_s: float | None = None,
        stop: threading.Event | None = None,
    ) -> None:
        """Connects to the router, trying again until it is there.

        Raises SettingError for a malformed router, KeyspaceError for a malformed swarm name,
        IdentityError for a certificate that cannot be shown, and TransportError when `timeout_s`
        has passed or `stop` was set first.
        """
        self.swarm = keyspace.check_name("swarm name", swarm)
        self._log = log or make_logger("session", swarm=swarm)
        identity = zenoh_config.identity_of(router)
        self.name = identity.name if identity is not None else ""
        """As whom this process asks, in a secure swarm; else empty."""
        self._connection = Connection(router, log=self._log, timeout_s=timeout_s, stop=stop)
        shown = self._connection.identity
        self._renewal = Renewal(shown, self._certificate, self._log) if shown else None
        self._servers: list[Server[Any]] = []
        self._present: list[set[str]] = []
        """Robots that are alive, as each `watch_alive` was told."""
        self._window = Window()
        self._senders_logged: set[str] = set()
        registry = registry or CollectorRegistry()
        self._invalid = Counter(
            "coadapt_messages_invalid_total",
            "Messages that did not validate and were dropped.",
            ["kind"],
            registry=registry,
        )
        links = Gauge("coadapt_links", "Transport links to the router.", registry=registry)
        links.set_function(self.links)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def put(self, key: str, message: Message, traffic: TrafficClass = TrafficClass.CONTROL) -> None:
        """Publishes a message; under congestion it is dropped rather than waited for.

        Raises TransportError when the session is closed.
        """
        try:
            self._connection.zenoh.put(
                key,
                encode(message),
                priority=traffic.priority,
                congestion_control=zenoh.CongestionControl.DROP,
                express=traffic is TrafficClass.CONTROL,
            )
        except zenoh.ZError as error:
            raise TransportError(f"cannot publish on {key}: {error}") from error

    def subscribe(
        self,
        key: str,
        kind: type[M],
        on_message: Callable[[M], object],
        on_invalid: Callable[[str, CoAdaptError], object] | None = None,
    ) -> Callable[[], None]:
        """Calls `on_message(message)` for every valid message on a key expression, until what is
        returned is called.

        Messages that do not validate are counted, logged once a sender, and dropped;
        `on_invalid(key, error)` hears of each. While a session that lost links is replaced, a
        message may come twice.
        """

        def receive(sample: zenoh.Sample) -> None:
            sender = str(sample.key_expr)
            try:
                message = decode(sample.payload.to_bytes(), kind)
                named = getattr(message, "robot", None) or getattr(message, "ego", None)
                if (
                    named is not None
                    and keyspace.belongs_to_robot(sender)
                    and keyspace.robot_of(sender) != named
                ):
                    raise MessageError(f"{kind.__name__} of {named!r} came on {sender}")
                if isinstance(message, NetState) and (
                    keyspace.controller_of(sender) != message.name
                ):
                    raise MessageError(f"the state of controller {message.name!r} came on {sender}")
            except (MessageError, KeyspaceError) as error:
                self._drop(kind, sender, error)
                if on_invalid is not None:
                    on_invalid(sender, error)
                return
            try:
                on_message(message)
            except Exception:
                # A handler's fault must not end Zenoh's thread, which serves other messages too.
                self._log.error("handler_failed", key=sender, exc_info=True)

        start_at_zero(self._invalid, (kind.__name__,))
        return self._connection.declare(lambda session: session.declare_subscriber(key, receive))

    def serve(
        self,
        key: str,
        kind: type[M],
        handler: Callable[[M], Message],
        *,
        workers: int = 2,
        waiting: int = MAX_WAITING_QUERIES,
        newest_first: bool = False,
    ) -> None:
        """Answers queries on a key with `handler(request)`, on `workers` threads, in the order in
        which they came; the newest first where an old one is worth less.

        A CoAdaptError of the handler travels to the asker as a `Refusal`; so do a request that
        does not validate and one that finds `waiting` others (with `newest_first` the oldest of
        these in its place). In a secure swarm the handler sees who asks as the certificate says:
        that is the request's `operator`, and a request in the name of another `ego` is refused. A
        large answer travels in parts; once its asker has stopped waiting, no
        answer is begun and no more parts are sent.
        """
        start_at_zero(self._invalid, (kind.__name__,))
        server = Server(
            key,
            kind,
            handler,
            workers=workers,
            waiting=waiting,
            newest_first=newest_first,
            log=self._log,
            on_invalid=lambda error: self._drop(kind, key, error),
        )
        self._servers.append(server)
        served = keyspace.by(key, keyspace.ANY) if self.name else key
        self._connection.declare(
            lambda session: session.declare_queryable(served, server.receive, complete=True)
        )

    def ask(
        self,
        key: str,
        request: Message,
        kind: type[M],
        *,
        timeout_s: float,
        traffic: TrafficClass = TrafficClass.FUSION,
    ) -> Future[Answer[M]]:
        """Sends a request to the one queryable on a key; the answer comes through the future.

        The future raises TransportError when nobody answers in time or a part of the answer is
        missing, RefusedError when the answer is a refusal, and MessageError when the answer or one
        of its parts does not validate. It is always done soon after `timeout_s`.
        """
        asked = keyspace.by(key, self.name) if self.name else key
        question = Question(
            asked, kind, timeout_s, self._window, lambda error: self._drop(kind, key, error)
        )
        question.send(self._connection.zenoh, request, traffic)
        return question.future

    def declare_alive(self, robot: str) -> Callable[[], None]:
        """Shows the robot as alive until this session closes or its link breaks, or until what is
        returned is called."""
        key = keyspace.alive(self.swarm, robot)
        return self._connection.declare(lambda session: session.liveliness().declare_token(key))

    def watch_alive(
        self,
        on_join: Callable[[str], None],
        on_leave: Callable[[str], None],
        robot: str = keyspace.ANY,
    ) -> None:
        """Calls back with a robot id when a robot, or this one, joins (also those already there) or
        leaves."""

        present: set[str] = set()
        lock = threading.Lock()
        self._present.append(present)

        def receive(sample: zenoh.Sample) -> None:
            try:
                robot = keyspace.robot_of(str(sample.key_expr))
            except KeyspaceError as error:
                self._log.warning("liveliness_ignored", error=str(error))
                return
            joined = sample.kind == zenoh.SampleKind.PUT
            with lock:
                # A session that replaces another tells again of the robots that are there.
                if joined == (robot in present):
                    return
                (present.add if joined else present.discard)(robot)
            try:
                (on_join if joined else on_leave)(robot)
            except Exception:
                self._log.error("handler_failed", key=str(sample.key_expr), exc_info=True)

        key = keyspace.alive(self.swarm, robot)
        self._connection.declare(
            lambda session: session.liveliness().declare_subscriber(key, receive, history=True)
        )

    def declare_leading(self, ego: str) -> Callable[[], None]:
        """Shows that an ego leads, until this session closes or its link breaks, or until what is
        returned is called."""
        key = keyspace.ego_leads(self.swarm, ego)
        return self._connection.declare(lambda session: session.liveliness().declare_token(key))

    def watch_leading(self, ego: str, on_change: Callable[[bool], None]) -> None:
        """Calls back with whether an ego leads, whenever its token comes or goes."""
        self._watch_token(keyspace.ego_leads(self.swarm, ego), on_change)

    def declare_metrics(self, role: str, place: str) -> None:
        """Shows where a role's metrics are served until this session closes or its link breaks."""
        key = keyspace.metrics(self.swarm, role, place)
        self._connection.declare(lambda session: session.liveliness().declare_token(key))

    def declare_gateway(self) -> None:
        """Shows the LLM gateway as alive until this session closes or its link breaks."""
        key = keyspace.llm_alive(self.swarm)
        self._connection.declare(lambda session: session.liveliness().declare_token(key))

    def watch_gateway(self, on_change: Callable[[bool], None]) -> Callable[[], None]:
        """Calls back with whether an LLM gateway is alive, whenever its token comes or goes, until
        what is returned is called."""
        return self._watch_token(keyspace.llm_alive(self.swarm), on_change)

    def _watch_token(self, key: str, on_change: Callable[[bool], None]) -> Callable[[], None]:
        def receive(sample: zenoh.Sample) -> None:
            try:
                on_change(sample.kind == zenoh.SampleKind.PUT)
            except Exception:
                self._log.error("handler_failed", key=str(sample.key_expr), exc_info=True)

        return self._connection.declare(
            lambda session: session.liveliness().declare_subscriber(key, receive, history=True)
        )

    def alive(self, timeout_s: float = 1.0) -> tuple[str, ...]:
        """The ids of the robots that are alive now, sorted.

        Raises TransportError when the session is closed.
        """
        # Also those of which this session was told: its own word may come before the router's.
        found = {robot for present in self._present for robot in tuple(present)}
        try:
            replies = self._connection.zenoh.liveliness().get(
                keyspace.alive(self.swarm, keyspace.ANY),
                # A session that watches tokens answers itself, before it can be read from: with
                # Zenoh's 256 places it waited for ever.
                zenoh.handlers.FifoChannel(MAX_ALIVE),
                timeout=timeout_s,
            )
        except zenoh.ZError as error:
            raise TransportError(f"cannot ask who is alive: {error}") from error
        for reply in replies:
            if reply.ok is not None:
                # A token whose id is no id is not one of ours.
                with suppress(KeyspaceError):
                    found.add(keyspace.robot_of(str(reply.ok.key_expr)))
        return tuple(sorted(found))

    def links(self) -> int:
        """Number of transport links to the router that are up."""
        return self._connection.links()

    def drain(self, timeout_s: float) -> bool:
        """Refuses new queries from now on, and waits until those taken are answered.

        Call it before `close`, which leaves them without an answer. Returns whether all were
        answered in time.
        """
        until = time.monotonic() + timeout_s
        return all(server.drain(until) for server in self._servers)

    def close(self) -> None:
        """Withdraws everything and closes; never waits longer than a few seconds."""
        if self._renewal is not None:
            self._renewal.close()
        for server in self._servers:
            server.close()
        self._servers.clear()
        self._connection.close()

    def _certificate(self) -> str:
        """What the authority issued last to who this process is. Raises TransportError, and
        RefusedError."""
        return last_issued(self._connection.zenoh, self.swarm, self.name)

    def _drop(self, kind: type[Message], sender: str, error: CoAdaptError) -> None:
        self._invalid.labels(kind.__name__).inc()
        if sender not in self._senders_logged and len(self._senders_logged) < (
            MAX_REMEMBERED_SENDERS
        ):
            self._senders_logged.add(sender)
            self._log.warning("message_invalid", key=sender, error=str(error)[:300])
