"""TLS of the swarm's own HTTP endpoints, with the certificate that a role shows the router."""

from __future__ import annotations

import socket
import ssl
import threading
from contextlib import suppress

from swarm.errors import IdentityError
from swarm.trust.identity import Identity

SERVER_NAME = "process.coadapt.internal"
"""What every role's certificate says beside its common name, so that who asks several processes,
as Prometheus does, can hold all of them to one name. The domain is reserved: no public authority
gives certificates for it."""

GOODBYE_S = 1.0


class ServerTls:
    """Wraps a server's connections; a certificate that was renewed is shown from then on."""

    def __init__(self, identity: Identity) -> None:
        """Raises IdentityError for files that cannot be used."""
        self._identity = identity
        self._lock = threading.Lock()
        self._context, self._version = self._load()

    def wrapped(self, connection: socket.socket) -> ssl.SSLSocket:
        """A connection whose handshake comes with the first byte that is read."""
        with self._lock:
            if self._identity.version() != self._version:
                # While the two files are written, what was read before is shown.
                with suppress(IdentityError):
                    self._context, self._version = self._load()
            context = self._context
        return context.wrap_socket(connection, server_side=True, do_handshake_on_connect=False)

    @staticmethod
    def say_goodbye(connection: socket.socket) -> None:
        """Ends TLS on a connection before that is closed: without it an answer whose length nobody
        has told would look cut off. Waits GOODBYE_S at most for the other side."""
        if isinstance(connection, ssl.SSLSocket):
            with suppress(OSError, ValueError):
                connection.settimeout(GOODBYE_S)
                connection.unwrap()

    def _load(self) -> tuple[ssl.SSLContext, tuple[int, ...]]:
        version = self._identity.version()
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        try:
            context.load_cert_chain(self._identity.certificate, self._identity.key)
        except (OSError, ssl.SSLError) as error:
            raise IdentityError(
                f"{self._identity.certificate} and its key cannot be used to serve: {error}; "
                f"`coadapt certs issue {self._identity.name}` makes new ones"
            ) from error
        return context, version
