"""Which sinks events may be sent to, and what they are shown."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from urllib.parse import urlsplit

from msgspec import UNSET

from network_controller.qod.destinations import Destinations
from network_controller.qod.messages import CreateSession, SinkCredential
from network_controller.qod.problems import (
    invalid,
    invalid_credential,
    invalid_sink,
    invalid_token,
)
from swarm.http.access import is_token


@dataclass(frozen=True, slots=True)
class Sink:
    """Where a session's events go."""

    secure: bool
    host: str
    port: int
    target: str
    """Path and query."""
    token: str | None
    expires: datetime | None
    """When the token ends; nothing is sent afterwards."""

    def __repr__(self) -> str:
        return f"Sink({self.host}:{self.port})"


def sink_of(request: CreateSession, destinations: Destinations) -> Sink | None:
    """The sink that a request names, or None. Waits for the addresses of its host.

    Raises Problem for one that cannot be used.
    """
    credential = request.sink_credential
    token, expires = (None, None) if credential is UNSET else _token(credential)
    if request.sink is UNSET:
        return None
    url = request.sink
    if not re.fullmatch("[!-~]+", url):
        raise invalid_sink("sink must be a URL of printable ASCII characters")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise invalid_sink(f"sink is not a URL: {error}") from error
    if not host or parts.scheme not in ("http", "https") or port == 0:
        raise invalid_sink("sink must be https://host[:port]/path")
    if "@" in parts.netloc:
        raise invalid_sink("sink must not name a user; give an access token as sinkCredential")
    secure = parts.scheme == "https"
    addresses = destinations.checked_soon(host)
    if not secure and not all(address.is_loopback for address in addresses):
        raise invalid_sink("sink must be https; http is allowed on this host's loopback only")
    target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return Sink(secure, host, port or (443 if secure else 80), target, token, expires)


def _token(credential: SinkCredential) -> tuple[str, datetime]:
    if credential.credential_type != "ACCESSTOKEN":
        raise invalid_credential(
            f"sinkCredential.credentialType {credential.credential_type} is of no use here; it "
            "must be ACCESSTOKEN"
        )
    token, expires = credential.access_token, credential.access_token_expires_utc
    kind = credential.access_token_type
    if token is UNSET or expires is UNSET or kind is UNSET:
        raise invalid("sinkCredential needs accessToken, accessTokenExpiresUtc and accessTokenType")
    if kind.lower() != "bearer":
        raise invalid_token(f"sinkCredential.accessTokenType {kind!r} must be 'bearer'")
    if not is_token(token):
        raise invalid_token("sinkCredential.accessToken has characters that no bearer token has")
    if expires <= datetime.now(UTC):
        raise invalid_token("sinkCredential.accessTokenExpiresUtc is over")
    return token, expires
