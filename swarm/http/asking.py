"""One question to an HTTP server, on a connection of its own."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from urllib.parse import urlsplit

from swarm.errors import TransportError

SCHEMES = {"http": HTTPConnection, "https": HTTPSConnection}


def ask(
    url: str,
    *,
    timeout_s: float,
    most_bytes: int,
    body: bytes | None = None,
    headers: Mapping[str, str] | None = None,
) -> tuple[int, bytes]:
    """Status and body, at most so many bytes of it, of a GET, or of a POST where there is a body.

    Asks no proxy of the environment, as what is asked runs here or is named by the user, and
    follows no redirect, so a key in the headers reaches this server alone. Raises TransportError
    where nothing answers, not by HTTP, or the URL is none.
    """
    try:
        parts = urlsplit(url)
        if parts.scheme not in SCHEMES or not parts.hostname:
            raise TransportError(f"{url!r} is no URL of a server; allowed: {', '.join(SCHEMES)}")
        target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        with closing(
            SCHEMES[parts.scheme](parts.hostname, parts.port, timeout=timeout_s)
        ) as connection:
            method = "GET" if body is None else "POST"
            connection.request(method, target, body, dict(headers or {}))
            reply = connection.getresponse()
            return reply.status, reply.read(most_bytes)
    # ValueError: also a port or a header that cannot be one.
    except (OSError, HTTPException, ValueError, OverflowError) as error:
        raise TransportError(str(error) or type(error).__name__) from error
