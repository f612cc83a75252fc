"""The HTTP server that metrics are read from: one for each process of a swarm, so a small one."""

from __future__ import annotations

import contextlib
import socket
import socketserver
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any

from prometheus_client import CollectorRegistry, MetricsHandler

from swarm.http.hosts import OWN, is_loopback
from swarm.http.places import may_stay, origin
from swarm.trust.identity import Identity
from swarm.trust.serving import ServerTls

PLACES = 16
"""Connections at a time, each on a thread of its own; one address has half of them at most."""
CONNECTION_S = 10.0
"""How long a connection may last, with its request and the answer."""
_BACKLOG = 32


class MetricsHttpServer(socketserver.ThreadingTCPServer):
    """Answers with one registry's metrics. Raises OSError where the port cannot be bound."""

    allow_reuse_address = True
    daemon_threads = True
    request_queue_size = _BACKLOG

    def __init__(
        self,
        registry: CollectorRegistry,
        host: str,
        port: int,
        identity: Identity | None = None,
    ) -> None:
        """On loopback, only requests for this host's own names are answered: a web page elsewhere
        can have its own lead here. With an identity it speaks TLS; raises IdentityError for one
        that cannot be shown."""
        self._tls = ServerTls(identity) if identity is not None else None
        found = socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        self.address_family, address = found[0][0], found[0][4]
        self.own_names = is_loopback(host)
        self._lock = threading.Lock()
        self._taken: dict[socket.socket, _Place] = {}
        handler = type("Handler", (_Handler,), {"registry": registry})
        super().__init__((str(address[0]), port), handler)

    def get_request(self) -> tuple[socket.socket, Any]:
        """A new connection; its handshake is left to the thread that serves it."""
        connection, address = super().get_request()
        if self._tls is not None:
            connection = self._tls.wrapped(connection)
        return connection, address

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Whether a new connection finds a place; one that does not is closed."""
        who = origin(client_address[0])
        with self._lock:
            if not may_stay(who, (place.origin for place in self._taken.values()), PLACES):
                return False
            self._taken[request] = _Place(who, time.monotonic() + CONNECTION_S)
            return True

    def service_actions(self) -> None:
        """Cuts off connections whose time is over; called twice a second."""
        now_s = time.monotonic()
        with self._lock:
            for connection, place in self._taken.items():
                if now_s > place.until_s:
                    with contextlib.suppress(OSError):
                        # Not TLS's own, which is another thread's at this moment.
                        socket.socket.shutdown(connection, socket.SHUT_RDWR)

    def shutdown_request(self, request: Any) -> None:
        """Ends a connection in order."""
        ServerTls.say_goodbye(request)
        super().shutdown_request(request)

    def close_request(self, request: Any) -> None:
        """Gives a place back."""
        # Under the lock: nothing may be cut off that has got this descriptor since.
        with self._lock:
            self._taken.pop(request, None)
            super().close_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Tells of faults, but not of clients who leave or are cut off."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


@dataclass(frozen=True, slots=True)
class _Place:
    origin: str
    until_s: float


class _Handler(MetricsHandler):
    server: MetricsHttpServer
    timeout = CONNECTION_S

    def do_GET(self) -> None:
        if self.server.own_names and not OWN.may(self.headers.get("Host", "")):
            self.send_error(
                403, explain="metrics are told under this host's own addresses and as localhost"
            )
            return
        super().do_GET()
