"""Delivers events to sinks, in the background.

A sink that is slow, broken or gone costs itself its events, and nobody else more than a delay.
"""

from __future__ import annotations

import contextlib
import http.client
import socket
import ssl
import threading
import time
import zlib
from collections import deque
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import msgspec

from network_controller.qod.destinations import Address, Destinations
from network_controller.qod.messages import StatusEvent
from network_controller.qod.metrics import QodMetrics
from network_controller.qod.problems import Problem, invalid_sink
from network_controller.qod.sinks import Sink
from swarm.log import Logger

LANES = 4
WAITING = 256
"""Events that wait in a lane; more are dropped."""
ATTEMPTS = 3
TIMEOUT_S = 3.0
"""For connecting, and once more for everything after it."""
PAUSE_S = 0.5
"""Before the second attempt; twice as long before the third."""
GRACE_S = 2.0
"""For what waits when the API is closed."""


class _Post(NamedTuple):
    sink: Sink
    event: StatusEvent


class Notifier:
    """Takes events without waiting. Those for one sink arrive in their order, each at most once
    unless an answer got lost."""

    def __init__(self, destinations: Destinations, metrics: QodMetrics, log: Logger) -> None:
        self._metrics = metrics
        self._lanes = [_Lane(f"qod-events-{n}", destinations, metrics, log) for n in range(LANES)]

    def start(self) -> None:
        """Begins to deliver."""
        for lane in self._lanes:
            lane.start()

    def post(self, sink: Sink, event: StatusEvent) -> None:
        """Hands over an event; it is dropped and counted when too many wait."""
        # A sink keeps its lane: so its events keep their order, and it delays that lane only.
        lane = self._lanes[zlib.crc32(f"{sink.host}:{sink.port}".encode()) % LANES]
        if not lane.put(_Post(sink, event)):
            self._metrics.events.labels("dropped").inc()

    def close(self) -> None:
        """Tries what still waits once, for GRACE_S at most."""
        for lane in self._lanes:
            lane.finish()
        deadline_s = time.monotonic() + GRACE_S + 2 * TIMEOUT_S
        for lane in self._lanes:
            if lane.is_alive():
                lane.join(max(0.0, deadline_s - time.monotonic()))


class _Lane(threading.Thread):
    def __init__(
        self, name: str, destinations: Destinations, metrics: QodMetrics, log: Logger
    ) -> None:
        super().__init__(name=name, daemon=True)
        self._destinations = destinations
        self._metrics = metrics
        self._log = log
        self._posts: deque[_Post] = deque()
        self._changed = threading.Condition()
        self._last_s: float | None = None

    def put(self, post: _Post) -> bool:
        with self._changed:
            if len(self._posts) >= WAITING:
                return False
            self._posts.append(post)
            self._changed.notify_all()
            return True

    def finish(self) -> None:
        with self._changed:
            self._last_s = time.monotonic() + GRACE_S
            self._changed.notify_all()

    def run(self) -> None:
        while (post := self._next()) is not None:
            try:
                outcome = self._deliver(post)
            except Exception:
                # The other sinks of this lane still want their events.
                self._log.error("qod_event_failed", sink=repr(post.sink), exc_info=True)
                outcome = "failed"
            self._metrics.events.labels(outcome).inc()

    def _next(self) -> _Post | None:
        with self._changed:
            self._changed.wait_for(lambda: self._posts or self._last_s is not None)
            if self._last_s is not None and time.monotonic() > self._last_s:
                self._metrics.events.labels("dropped").inc(len(self._posts))
                return None
            return self._posts.popleft() if self._posts else None

    def _deliver(self, post: _Post) -> str:
        """What became of an event: delivered, refused by the sink, failed, too late for its
        token, or forbidden because the sink's name leads elsewhere now."""
        outcome = reason = "failed"
        for attempt in range(ATTEMPTS):
            if attempt and self._closing_within(PAUSE_S * attempt):
                break
            if post.sink.expires is not None and post.sink.expires <= datetime.now(UTC):
                return "expired"
            try:
                status = _send(post, self._destinations)
            except Problem as problem:
                outcome, reason = "forbidden", problem.info.message
                break
            except (OSError, http.client.HTTPException, ValueError) as error:
                outcome, reason = "failed", str(error) or type(error).__name__
                continue
            if 200 <= status < 300:
                return "delivered"
            outcome, reason = "refused", f"status {status}"
            if status != 429 and status < 500:
                break
        self._log.warning(
            "qod_event_undelivered", sink=repr(post.sink), outcome=outcome, reason=reason
        )
        return outcome

    def _closing_within(self, seconds: float) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: self._last_s is not None, seconds)


def _send(post: _Post, destinations: Destinations) -> int:
    """The sink's status. Redirects are not followed: they might lead anywhere, and the token is for
    this sink only."""
    sink = post.sink
    headers = {"Content-Type": "application/cloudevents+json"}
    if sink.token is not None:
        headers["Authorization"] = f"Bearer {sink.token}"
    connection: http.client.HTTPConnection
    if sink.secure:
        context = ssl.create_default_context()
        connection = http.client.HTTPSConnection(sink.host, sink.port, context=context)
    else:
        context = None
        connection = http.client.HTTPConnection(sink.host, sink.port)
    with contextlib.closing(connection):
        # Given a socket, it looks up and connects to nothing by itself.
        sock = connection.sock = _connected(sink, destinations, context)
        # The socket's timeout starts again with every byte; this one does not.
        limit = threading.Timer(TIMEOUT_S, _cut, (sock,))
        limit.daemon = True
        limit.start()
        try:
            if isinstance(sock, ssl.SSLSocket):
                sock.do_handshake()
            connection.request("POST", sink.target, msgspec.json.encode(post.event), headers)
            with connection.getresponse() as response:
                return response.status
        finally:
            limit.cancel()


def _connected(
    sink: Sink, destinations: Destinations, context: ssl.SSLContext | None
) -> socket.socket:
    """A connection to an address that has just been checked; TLS has not shaken hands yet.

    Raises Problem where the sink's name leads to what is not allowed, and OSError.
    """
    addresses = destinations.checked(sink.host)
    if context is None and not all(address.is_loopback for address in addresses):
        raise invalid_sink(f"sink's host {sink.host!r} is not on loopback, and not asked by https")
    connected = _first(addresses, sink.port)
    if context is None:
        return connected
    try:
        return context.wrap_socket(
            connected, server_hostname=sink.host, do_handshake_on_connect=False
        )
    except BaseException:
        connected.close()
        raise


def _first(addresses: Sequence[Address], port: int) -> socket.socket:
    """A connection to the first address that answers. Raises OSError."""
    deadline_s = time.monotonic() + TIMEOUT_S
    for address in addresses:
        try:
            left_s = max(0.1, deadline_s - time.monotonic())
            connected = socket.create_connection((str(address), port), left_s)
        except OSError as error:
            failure = error
        else:
            connected.settimeout(TIMEOUT_S)
            return connected
    raise failure


def _cut(sock: socket.socket) -> None:
    with contextlib.suppress(OSError):
        # Not TLS's own shutdown, which is not made for a second thread.
        socket.socket.shutdown(sock, socket.SHUT_RDWR)
