"""What all HTTP endpoints of the swarm have in common: the socket, and how it is served."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import sys
from collections.abc import Generator, Mapping
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from swarm.errors import SettingError
from swarm.http.hosts import is_loopback
from swarm.http.places import may_stay, origin

REQUEST_S = 20.0
"""How long a client may take to send a whole request, from when he may begin it."""
UNTAKEN_S = 60.0
"""A connection whose other end takes nothing of what was sent is let go after so long."""
_BACKLOG = 128


def media_type(headers: Mapping[str, str]) -> str:
    """What a body is declared as, without parameters and in small letters; "" where nothing is."""
    return headers.get("content-type", "").split(";")[0].strip().lower()


class HttpServer(uvicorn.Server):
    """A server on a process's main thread that leaves signals to the process."""

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None]:
        """Handles none."""
        yield


_NO_PLACE = (
    b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n"
    b"Retry-After: 1\r\n\r\n"
)


class _Punctual(H11Protocol):
    """Lets go of a client who does not send a whole request within `REQUEST_S`, and of one whose
    address has its share of the connections.

    uvicorn bounds only the wait between two requests, and each byte ends that wait: connections
    that say nothing, or a body byte by byte, would take all places for good.
    """

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Somebody is there, and owes a request."""
        super().connection_made(transport)
        others = (_origin(other) for other in self.connections if other is not self)
        if may_stay(_origin(self), others, self.limit_concurrency or sys.maxsize):
            self._time_client()
        else:
            transport.write(_NO_PLACE)
            transport.close()

    def handle_events(self) -> None:
        """After new bytes, and after each answer."""
        super().handle_events()
        self._time_client()

    def connection_lost(self, exc: Exception | None) -> None:
        """Nothing is owed any more."""
        self._forgive()
        super().connection_lost(exc)

    def _time_client(self) -> None:
        owes = self.conn.their_state in (h11.IDLE, h11.SEND_BODY)
        if not owes:
            self._forgive()
        elif self._late is None:
            self._late = self.loop.call_later(REQUEST_S, self.transport.abort)

    def _forgive(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None


def _origin(connection: Any) -> str:
    """Whose a connection is, as places are shared; "" on a Unix socket."""
    return origin(connection.client[0]) if connection.client else ""


def bind(prefix: str, host: str, port: int, *, token: bool) -> socket.socket:
    """A listening socket; port 0 takes a free one, and an open host needs a `token`.

    `prefix` begins the names of the settings (`COADAPT_QOD`) that a SettingError names.
    """
    if not token and not is_loopback(host):
        raise SettingError(
            f"{prefix}_HOST = {host!r} can be reached from elsewhere, and "
            f"{prefix}_TOKEN is not set; set a token, or {prefix}_TOKEN_FILE, or use 127.0.0.1"
        )
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        bound = socket.create_server((host, port), family=family, backlog=_BACKLOG)
    except (OSError, OverflowError) as error:
        raise SettingError(
            f"{prefix}_PORT = {port} on {prefix}_HOST = {host!r} cannot be bound: {error}; "
            "choose a free port (0 takes any) and an address of this host"
        ) from error
    # Connections inherit it. asyncio sets it only on sockets that it has made itself; without it
    # an answer in two packets waits for the client's delayed acknowledgement, 40 ms.
    bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    # Also inherited. Closing would wait for ever until the other end takes what is buffered.
    bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * UNTAKEN_S))
    return bound


def server_config(app: Any, *, connections: int, grace_s: int) -> uvicorn.Config:
    """How an ASGI app is served. There are fewer than `connections` at a time, shared among those
    who connect as `may_stay` says; what is too much is answered with 503 and closed."""
    return uvicorn.Config(
        app,
        loop="asyncio",
        http=_Punctual,
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        limit_concurrency=connections,
        timeout_graceful_shutdown=grace_s,
    )
