"""The server's side of queries: a handler's answers, in parts as far as the askers' credit goes."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Generic, NamedTuple, TypeVar

import msgspec
import zenoh

from swarm import chunks, keyspace
from swarm.chunks import AskParts, MoreParts
from swarm.credit import Credits
from swarm.errors import CoAdaptError, MessageError
from swarm.log import Logger
from swarm.messages import MAX_MESSAGE_BYTES, Message, Refusal, decode, encode
from swarm.places import Places
from swarm.trust.roles import Role

M = TypeVar("M", bound=Message)
MAX_WAITING_QUERIES = 16
_LEARNT = 0.2


class _Taken(NamedTuple, Generic[M]):
    """A query that was taken."""

    query: zenoh.Query
    request: M
    asked: AskParts | None
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
        they came, or the newest first; then the oldest one gives way to one more. With
        `newest_first` a request that would wait beyond its own `deadline_s` is refused. Who asks
        (the request's `ego`) has a share of them, and never all of several workers. `on_invalid`
        hears of a request that does not validate."""
        self._key = key
        self._kind = kind
        self._handler = handler
        self._log = log
        self._on_invalid = on_invalid
        self._robot = keyspace.robot_of(key) if keyspace.belongs_to_robot(key) else ""
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="serve")
        self._max_waiting = waiting
        self._places: Places[_Taken[M]] = Places(
            waiting, max(1, workers - 1), newest_first=newest_first
        )
        self._credits = Credits()
        self._workers = workers
        self._newest_first = newest_first
        self._handling_s = 0.0
        """What a handler takes, smoothed."""
        self._woken = 0
        """Threads that were told to look for what waits, and have not begun to."""
        self._waking = threading.Lock()

    def receive(self, query: zenoh.Query) -> None:
        """Takes a query on Zenoh's thread and hands it over."""
        attachment = query.attachment
        asked = chunks.read_query(attachment.to_bytes() if attachment is not None else None)
        if isinstance(asked, MoreParts):
            with query:
                self._credits.give(asked.token, asked.parts)
            return
        try:
            request = decode(query.payload.to_bytes() if query.payload else b"", self._kind)
            name = keyspace.asker_of(str(query.key_expr))
            request = _in_the_name_of(request, name)
        except MessageError as error:
            self._on_invalid(error)
            with query:
                self._refuse(query, str(error))
            return
        # By this process's own clock, from now: the asker's may show another time.
        now = time.monotonic()
        until = math.inf if asked is None else now + asked.timeout_s
        due = now + self._deadline_s(request)
        if (wait_s := self._wait_s()) > due - now:
            with query:
                why = f"busy: this would wait for {wait_s:.2f} s"
                self._refuse(query, why, getattr(request, "request", 0), "busy")
            return
        taken = _Taken(query, request, asked, until)
        loser = self._places.add(name or _asker(request), taken, due)
        if loser is not None:
            with loser.query:
                why = f"busy: {self._max_waiting} requests are waiting already"
                self._refuse(loser.query, why, code="busy")
        if loser is not taken:
            self._wake()

    def _deadline_s(self, request: M) -> float:
        """How soon an answer is of use, where old ones are worth less; infinity: any time."""
        told = getattr(request, "deadline_s", 0.0) if self._newest_first else 0.0
        return float(told) or math.inf

    def _wait_s(self) -> float:
        """How long one more query would wait until it is handled, while others are ahead of it; 0
        for the first, so that what handlers take is never only believed."""
        ahead = self._places.ahead()
        return self._handling_s * (ahead / self._workers + 1.0) if ahead >= self._workers else 0.0

    def drain(self, until: float) -> bool:
        """Refuses new queries from now on, and waits until those taken are answered.

        `until` is monotonic seconds; returns whether that was in time.
        """
        return self._places.drain(until)

    def close(self) -> None:
        """Begins no further answer and stops those under way; does not wait for handlers."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._places.close()
        self._credits.close_all()

    def _wake(self) -> None:
        """Lets one more thread look for what waits, unless all will look anyway."""
        with self._waking:
            if self._woken >= self._workers:
                return
            self._woken += 1
        # The session may be closing: nothing waits then.
        with suppress(RuntimeError):
            self._pool.submit(self._answer)

    def _answer(self) -> None:
        """Answers what waits, until there is nothing that this thread may begin."""
        with self._waking:
            self._woken -= 1
        while (found := self._places.next()) is not None:
            asker, taken = found
            try:
                with taken.query:
                    if time.monotonic() < taken.until:
                        self._handle(asker, taken)
            except zenoh.ZError as error:
                self._log.warning("reply_failed", key=self._key, error=str(error))
            finally:
                self._places.done(asker)

    def _handle(self, asker: str, taken: _Taken[M]) -> None:
        query, request, asked, until = taken
        number = getattr(request, "request", 0)
        begun = time.monotonic()
        try:
            data = encode(self._handler(request))
            self._handling_s += _LEARNT * (time.monotonic() - begun - self._handling_s)
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
                query.reply(query.key_expr, data)
            else:
                self._send(asker, query, data, asked, until)

    def _send(
        self, asker: str, query: zenoh.Query, data: bytes, asked: AskParts, until: float
    ) -> None:
        """Sends an answer as far as credit comes, and until nobody waits for it any more. One that
        stands gives way to somebody else's."""
        self._credits.open(asked.token, asked.parts)
        try:
            for number, (attachment, part) in enumerate(chunks.split(data), 1):
                if not self._credits.wait(
                    asked.token, number, until, wanted=lambda: self._places.wanted(asker)
                ):
                    self._log.debug("answer_abandoned", key=self._key, parts=number - 1)
                    return
                query.reply(query.key_expr, part, attachment=attachment)
        finally:
            self._credits.close(asked.token)

    def _refuse(self, query: zenoh.Query, reason: str, request: int = 0, code: str = "") -> None:
        refusal = Refusal(robot=self._robot, request=request, reason=reason, code=code)
        query.reply_err(encode(refusal))


def _in_the_name_of(request: M, name: str) -> M:
    """The request as the one who asks may make it. Raises MessageError for one in the name of
    another ego; without a name it says itself who asks."""
    if not name:
        return request
    ego = getattr(request, "ego", None)
    if ego is not None and name != Role("ego", ego).common_name:
        raise MessageError(f"{name} asks in the name of ego {ego!r}")
    if hasattr(request, "operator"):
        return msgspec.structs.replace(request, operator=name)
    return request


def _asker(request: Message) -> str:
    return str(getattr(request, "ego", ""))
