"""The server's side of queries: a handler's answers, in parts as far as the askers' credit goes."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Generic, NamedTuple, TypeVar

import zenoh

from swarm import chunks, keyspace
from swarm.chunks import Ask, More
from swarm.credit import Credits
from swarm.errors import CoAdaptError, MessageError
from swarm.log import Logger
from swarm.messages import MAX_MESSAGE_BYTES, Message, Refusal, decode, encode

M = TypeVar("M", bound=Message)
MAX_WAITING_QUERIES = 16


class _Taken(NamedTuple):
    """A query that was taken."""

    query: zenoh.Query
    asked: Ask | None
    until: float
    """When its asker stops waiting, `time.monotonic()` seconds."""


class Server(Generic[M]):
    """Answers the queries on one key with a handler, on threads of its own."""

    def __init__(
        self,
        key: str,
        kind: type[M],
        handler: Callable[[M], Message],
        *,
        workers: int,
        waiting: int = MAX_WAITING_QUERIES,
        newest_first: bool = False,
        log: Logger,
        on_invalid: Callable[[MessageError], None],
    ) -> None:
        """At most `waiting` queries are taken at a time, which are answered in the order in which
        they came, or the newest first; then the oldest one gives way to one more. `on_invalid`
        hears of a request that does not validate."""
        self._key = key
        self._kind = kind
        self._handler = handler
        self._log = log
        self._on_invalid = on_invalid
        self._robot = keyspace.robot_of(key) if keyspace.belongs_to_robot(key) else ""
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="serve")
        self._max_waiting = waiting
        # A place is given back when an answer has been sent.
        self._waiting = threading.BoundedSemaphore(waiting)
        self._newest_first = newest_first
        self._queries: deque[_Taken] = deque()
        """Those that wait for a thread."""
        self._credits = Credits()

    def receive(self, query: zenoh.Query) -> None:
        """Takes a query on Zenoh's thread and hands it over."""
        attachment = query.attachment
        asked = chunks.read_query(attachment.to_bytes() if attachment is not None else None)
        if isinstance(asked, More):
            with query:
                self._credits.give(asked.token, asked.parts)
            return
        # By this process's own clock, from now: the asker's may show another time.
        until = math.inf if asked is None else time.monotonic() + asked.timeout_s
        taken = _Taken(query, asked, until)
        if not self._waiting.acquire(blocking=False):
            self._crowd_out(taken)
            return
        self._queries.append(taken)
        try:
            self._pool.submit(self._answer_next)
        except RuntimeError:
            # The session is closing.
            with suppress(ValueError):
                self._queries.remove(taken)
            with query:
                self._refuse(query, "closing")

    def drain(self, until: float) -> bool:
        """Refuses new queries from now on, and waits until those taken are answered.

        `until` is monotonic seconds; returns whether that was in time.
        """
        return all(
            self._waiting.acquire(timeout=max(0.0, until - time.monotonic()))
            for _ in range(self._max_waiting)
        )

    def close(self) -> None:
        """Begins no further answer and stops those under way; does not wait for handlers."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._queries.clear()
        self._credits.close_all()

    def _crowd_out(self, newest: _Taken) -> None:
        """There are as many as may wait: one of them, or the newest, has to go."""
        loser = newest
        if self._newest_first:
            # In this order: there are never fewer queries than threads were told to answer.
            self._queries.append(newest)
            loser = self._queries.popleft()
        with loser.query:
            why = f"busy: {self._max_waiting} requests are waiting already"
            self._refuse(loser.query, why, code="busy")

    def _answer_next(self) -> None:
        query, asked, until = self._queries.pop() if self._newest_first else self._queries.popleft()
        try:
            with query:
                if time.monotonic() < until:
                    self._handle(query, asked, until)
        except zenoh.ZError as error:
            self._log.warning("reply_failed", key=self._key, error=str(error))
        finally:
            self._waiting.release()

    def _handle(self, query: zenoh.Query, asked: Ask | None, until: float) -> None:
        try:
            request = decode(query.payload.to_bytes() if query.payload else b"", self._kind)
        except MessageError as error:
            self._on_invalid(error)
            self._refuse(query, str(error))
            return
        number = getattr(request, "request", 0)
        try:
            data = encode(self._handler(request))
        except CoAdaptError as error:
            self._refuse(query, str(error), number, error.code)
        except Exception as error:
            self._log.error("handler_failed", key=self._key, exc_info=True)
            self._refuse(query, f"internal error: {type(error).__name__}", number)
        else:
            if len(data) > MAX_MESSAGE_BYTES:
                allowed = f"allowed: {MAX_MESSAGE_BYTES}"
                self._refuse(query, f"the answer has {len(data)} bytes; {allowed}", number)
            elif asked is None:
                query.reply(self._key, data)
            else:
                self._send(query, data, asked, until)

    def _send(self, query: zenoh.Query, data: bytes, asked: Ask, until: float) -> None:
        """Sends an answer as far as credit comes, and until nobody waits for it any more."""
        self._credits.open(asked.token, asked.parts)
        try:
            for number, (attachment, part) in enumerate(chunks.split(data), 1):
                if not self._credits.wait(asked.token, number, until):
                    self._log.debug("answer_abandoned", key=self._key, parts=number - 1)
                    return
                query.reply(self._key, part, attachment=attachment)
        finally:
            self._credits.close(asked.token)

    def _refuse(self, query: zenoh.Query, reason: str, request: int = 0, code: str = "") -> None:
        refusal = Refusal(robot=self._robot, request=request, reason=reason, code=code)
        query.reply_err(encode(refusal))
