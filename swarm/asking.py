"""The asker's side of a query: one request, an answer in one or several parts, or why not."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

import zenoh

from swarm.chunks import AskParts, Assembly, MoreParts
from swarm.credit import Download, Window
from swarm.errors import CoAdaptError, MessageError, RefusedError, TransportError
from swarm.messages import Message, Refusal, decode, encode
from swarm.traffic import TrafficClass

M = TypeVar("M", bound=Message)


@dataclass(frozen=True, slots=True)
class Answer(Generic[M]):
    """A reply to `Session.ask`."""

    message: M
    wire_bytes: int
    round_trip_s: float


class Question(Generic[M]):
    """One request under way; `future` is done when it is answered, refused, lost or late."""

    def __init__(
        self,
        key: str,
        kind: type[M],
        timeout_s: float,
        window: Window,
        on_invalid: Callable[[MessageError], None],
    ) -> None:
        """`on_invalid` hears of an answer that does not validate."""
        self.future: Future[Answer[M]] = Future()
        self._key = key
        self._kind = kind
        self._timeout_s = timeout_s
        self._on_invalid = on_invalid
        self._token = secrets.randbits(64)
        self._download = Download(window, self._ask_more)
        self._begun = time.perf_counter()

    def send(self, session: zenoh.Session, request: Message, traffic: TrafficClass) -> None:
        """Sends the request. Every failure comes through the future."""
        self._session = session
        asked = AskParts(self._token, self._timeout_s, self._download.first)
        try:
            session.get(
                self._key,
                zenoh.handlers.Callback(self._receive, self._finished),
                payload=encode(request),
                attachment=asked.pack(),
                timeout=self._timeout_s,
                target=zenoh.QueryTarget.BEST_MATCHING,
                consolidation=zenoh.ConsolidationMode.NONE,
                priority=traffic.priority,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        except zenoh.ZError as error:
            self._settle(TransportError(f"cannot ask {self._key}: {error}"))

    def _ask_more(self, parts: int) -> None:
        # On the query's own thread, which Zenoh does not wait for while its FIFO has room: it holds
        # many times what may be under way. Control, so that it overtakes what fills the links.
        self._session.get(
            self._key,
            zenoh.handlers.RingChannel(1),
            attachment=MoreParts(self._token, parts).pack(),
            timeout=self._timeout_s,
            target=zenoh.QueryTarget.BEST_MATCHING,
            consolidation=zenoh.ConsolidationMode.NONE,
            priority=TrafficClass.CONTROL.priority,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )

    def _receive(self, reply: zenoh.Reply) -> None:
        if self.future.done():
            return
        if reply.ok is None:
            self._settle(self._failure(reply.err))
            return
        data: bytes | None = reply.ok.payload.to_bytes()
        attachment = reply.ok.attachment
        try:
            if attachment is not None and data is not None:
                data = self._download.add(attachment.to_bytes(), data)
            if data is None:
                return
            message = decode(data, self._kind)
        except MessageError as error:
            self._on_invalid(error)
            self._settle(error)
        except zenoh.ZError as error:
            self._settle(TransportError(f"cannot ask {self._key} for more: {error}"))
        else:
            self._settle(Answer(message, len(data), self._waited_s()))

    def _finished(self) -> None:
        quick = self._waited_s() < self._timeout_s / 2
        self._settle(self._no_answer("nobody serves it" if quick else "none came in time"))

    def _settle(self, outcome: Answer[M] | CoAdaptError) -> None:
        # A reply and the end of the query may race; the first one counts.
        with suppress(InvalidStateError):
            if isinstance(outcome, CoAdaptError):
                self.future.set_exception(outcome)
            else:
                self.future.set_result(outcome)

    def _waited_s(self) -> float:
        return time.perf_counter() - self._begun

    def _failure(self, reply: zenoh.ReplyError | None) -> TransportError:
        """What an error reply means: a refusal of the asked process, or Zenoh's own `Timeout`."""
        data = reply.payload.to_bytes() if reply is not None else b""
        try:
            refusal = decode(data, Refusal)
            return RefusedError(refusal.reason, self._key, refusal.code)
        except MessageError:
            if data == b"Timeout":
                return self._no_answer("none came in time")
            return TransportError(f"{self._key} answered with an error of {len(data)} bytes")

    def _no_answer(self, why: str) -> TransportError:
        after = f"on {self._key} after {self._waited_s():.3f} s"
        assembly: Assembly = self._download.assembly
        if assembly.count:
            return TransportError(f"incomplete answer {after}: {assembly}")
        return TransportError(f"no answer {after}: {why}")
