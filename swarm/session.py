"""A swarm's session: typed messages over Zenoh, with traffic classes and validation at the edge.

Handlers given to `subscribe` and `watch_alive` run on Zenoh's own threads: they must return
quickly and must not call the session. Queryable handlers and answers run on this session's
threads and may take their time.
"""

from __future__ import annotations

import math
import secrets
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

import zenoh
from prometheus_client import CollectorRegistry, Counter, Gauge

from swarm import chunks, keyspace
from swarm.chunks import Ask, Assembly, More
from swarm.connection import Connection
from swarm.credit import Credits, Download, Window
from swarm.errors import CoAdaptError, KeyspaceError, MessageError, RefusedError, TransportError
from swarm.log import Logger, make_logger
from swarm.messages import MAX_MESSAGE_BYTES, Message, Refusal, decode, encode
from swarm.traffic import TrafficClass

M = TypeVar("M", bound=Message)
MAX_WAITING_QUERIES = 16
MAX_REMEMBERED_SENDERS = 256


@dataclass(frozen=True, slots=True)
class Answer(Generic[M]):
    """A reply to `Session.ask`."""

    message: M
    wire_bytes: int
    round_trip_s: float


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

        Raises SettingError for a malformed router, KeyspaceError for a malformed swarm name, and
        TransportError when `timeout_s` has passed or `stop` was set first.
        """
        self.swarm = keyspace.check_name("swarm name", swarm)
        self._log = log or make_logger("session", swarm=swarm)
        self._connection = Connection(router, log=self._log, timeout_s=timeout_s, stop=stop)
        self._pools: list[ThreadPoolExecutor] = []
        self._credits: list[Credits] = []
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

    def subscribe(self, key: str, kind: type[M], on_message: Callable[[M, str], None]) -> None:
        """Calls `on_message(message, key)` for every valid message on a key expression.

        Messages that do not validate are counted, logged once a sender, and dropped. While a
        session that lost links is replaced, a message may come twice.
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
            except (MessageError, KeyspaceError) as error:
                self._drop(kind, sender, error)
                return
            try:
                on_message(message, sender)
            except Exception:
                # A handler's fault must not end Zenoh's thread, which serves other messages too.
                self._log.error("handler_failed", key=sender, exc_info=True)

        self._connection.declare(lambda session: session.declare_subscriber(key, receive))

    def serve(
        self,
        key: str,
        kind: type[M],
        handler: Callable[[M], Message],
        *,
        workers: int = 2,
    ) -> None:
        """Answers queries on a key with `handler(request)`, on `workers` threads.

        A CoAdaptError of the handler travels to the asker as a `Refusal`; so do a request that
        does not validate and one that finds too many waiting. A large answer travels in parts;
        once its asker has stopped waiting, neither is an answer begun nor are more parts sent.
        """
        pool = ThreadPoolExecutor(workers, thread_name_prefix="serve")
        waiting = threading.BoundedSemaphore(MAX_WAITING_QUERIES)
        robot = keyspace.robot_of(key) if keyspace.belongs_to_robot(key) else ""
        credit = Credits()

        def refuse(query: zenoh.Query, reason: str, request: int = 0) -> None:
            query.reply_err(encode(Refusal(robot=robot, request=request, reason=reason)))

        def send(query: zenoh.Query, data: bytes, asked: Ask | None, until: float) -> None:
            if asked is None:
                query.reply(key, data)
                return
            credit.open(asked.token, asked.parts)
            try:
                for number, (attachment, part) in enumerate(chunks.split(data), 1):
                    if not credit.wait(asked.token, number, until):
                        self._log.debug("answer_abandoned", key=key, parts=number - 1)
                        return
                    query.reply(key, part, attachment=attachment)
            finally:
                credit.close(asked.token)

        def answer(query: zenoh.Query, asked: Ask | None, until: float) -> None:
            try:
                with query:
                    if time.monotonic() >= until:
                        return
                    try:
                        request = decode(query.payload.to_bytes() if query.payload else b"", kind)
                    except MessageError as error:
                        self._drop(kind, key, error)
                        refuse(query, str(error))
                        return
                    number = getattr(request, "request", 0)
                    try:
                        reply = encode(handler(request))
                        if len(reply) > MAX_MESSAGE_BYTES:
                            raise MessageError(
                                f"the answer has {len(reply)} bytes; allowed: {MAX_MESSAGE_BYTES}"
                            )
                    except CoAdaptError as error:
                        refuse(query, str(error), number)
                    except Exception as error:
                        self._log.error("handler_failed", key=key, exc_info=True)
                        refuse(query, f"internal error: {type(error).__name__}", number)
                    else:
                        send(query, reply, asked, until)
            except zenoh.ZError as error:
                self._log.warning("reply_failed", key=key, error=str(error))
            finally:
                waiting.release()

        def receive(query: zenoh.Query) -> None:
            attachment = query.attachment
            asked = chunks.read_query(attachment.to_bytes() if attachment is not None else None)
            if isinstance(asked, More):
                with query:
                    credit.give(asked.token, asked.parts)
                return
            # By this process's own clock, from now: the asker's may show another time.
            until = math.inf if asked is None else time.monotonic() + asked.timeout_s
            if not waiting.acquire(blocking=False):
                with query:
                    refuse(query, f"busy: {MAX_WAITING_QUERIES} requests are waiting already")
                return
            try:
                pool.submit(answer, query, asked, until)
            except RuntimeError:
                # The session is closing.
                with query:
                    refuse(query, "closing")

        self._credits.append(credit)
        self._pools.append(pool)
        self._connection.declare(
            lambda session: session.declare_queryable(key, receive, complete=True)
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
        future: Future[Answer[M]] = Future()
        begun = time.perf_counter()
        token = secrets.randbits(64)
        download = Download(
            self._window, lambda parts: self._ask_more(key, More(token, parts), timeout_s)
        )

        def settle(answer: Answer[M] | CoAdaptError) -> None:
            # A reply and the end of the query may race; the first one counts.
            with suppress(InvalidStateError):
                if isinstance(answer, CoAdaptError):
                    future.set_exception(answer)
                else:
                    future.set_result(answer)

        def receive(reply: zenoh.Reply) -> None:
            if future.done():
                return
            if reply.ok is None:
                settle(_failure(key, reply.err, time.perf_counter() - begun, download.assembly))
                return
            data = reply.ok.payload.to_bytes()
            attachment = reply.ok.attachment
            try:
                if attachment is not None:
                    whole = download.add(attachment.to_bytes(), data)
                    if whole is None:
                        return
                    data = whole
                message = decode(data, kind)
            except MessageError as error:
                self._drop(kind, key, error)
                settle(error)
                return
            except TransportError as error:
                settle(error)
                return
            settle(Answer(message, len(data), time.perf_counter() - begun))

        def finished() -> None:
            waited = time.perf_counter() - begun
            why = "nobody serves it" if waited < timeout_s / 2 else "none came in time"
            settle(_no_answer(key, waited, why, download.assembly))

        try:
            self._connection.zenoh.get(
                key,
                zenoh.handlers.Callback(receive, finished),
                payload=encode(request),
                attachment=Ask(token, timeout_s, download.first).pack(),
                timeout=timeout_s,
                target=zenoh.QueryTarget.BEST_MATCHING,
                consolidation=zenoh.ConsolidationMode.NONE,
                priority=traffic.priority,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        except zenoh.ZError as error:
            settle(TransportError(f"cannot ask {key}: {error}"))
        return future

    def _ask_more(self, key: str, more: More, timeout_s: float) -> None:
        """Gives credit to an answer under way. Raises TransportError when the session is closed."""
        try:
            self._connection.zenoh.get(
                key,
                zenoh.handlers.RingChannel(1),
                attachment=more.pack(),
                timeout=timeout_s,
                target=zenoh.QueryTarget.BEST_MATCHING,
                consolidation=zenoh.ConsolidationMode.NONE,
                priority=TrafficClass.CONTROL.priority,
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
            )
        except zenoh.ZError as error:
            raise TransportError(f"cannot ask {key} for more: {error}") from error

    def declare_alive(self, robot: str) -> None:
        """Shows the robot as alive until this session closes or its link breaks."""
        key = keyspace.alive(self.swarm, robot)
        self._connection.declare(lambda session: session.liveliness().declare_token(key))

    def watch_alive(self, on_join: Callable[[str], None], on_leave: Callable[[str], None]) -> None:
        """Calls back with a robot id when a robot joins (also those already there) or leaves."""

        present: set[str] = set()
        lock = threading.Lock()

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

        key = keyspace.alive(self.swarm, keyspace.ANY)
        self._connection.declare(
            lambda session: session.liveliness().declare_subscriber(key, receive, history=True)
        )

    def alive(self, timeout_s: float = 1.0) -> tuple[str, ...]:
        """The ids of the robots that are alive now, sorted.

        Raises TransportError when the session is closed.
        """
        found: set[str] = set()
        try:
            replies = self._connection.zenoh.liveliness().get(
                keyspace.alive(self.swarm, keyspace.ANY), timeout=timeout_s
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

    def close(self) -> None:
        """Withdraws everything and closes; never waits longer than a few seconds."""
        for pool in self._pools:
            pool.shutdown(wait=False, cancel_futures=True)
        self._pools.clear()
        for credit in self._credits:
            credit.close_all()
        self._connection.close()

    def _drop(self, kind: type[Message], sender: str, error: CoAdaptError) -> None:
        self._invalid.labels(kind.__name__).inc()
        if sender not in self._senders_logged and len(self._senders_logged) < (
            MAX_REMEMBERED_SENDERS
        ):
            self._senders_logged.add(sender)
            self._log.warning("message_invalid", key=sender, error=str(error)[:300])


def _failure(
    key: str, reply: zenoh.ReplyError | None, waited_s: float, assembly: Assembly
) -> TransportError:
    """What an error reply means: a refusal of the asked process, or Zenoh's own `Timeout`."""
    data = reply.payload.to_bytes() if reply is not None else b""
    try:
        return RefusedError(f"{key} refused: {decode(data, Refusal).reason}")
    except MessageError:
        if data == b"Timeout":
            return _no_answer(key, waited_s, "none came in time", assembly)
        return TransportError(f"{key} answered with an error of {len(data)} bytes")


def _no_answer(key: str, waited_s: float, why: str, assembly: Assembly) -> TransportError:
    if assembly.count:
        return TransportError(f"incomplete answer on {key} after {waited_s:.3f} s: {assembly}")
    return TransportError(f"no answer on {key} after {waited_s:.3f} s: {why}")
