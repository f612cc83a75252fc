"""Telling where a process serves its metrics: a liveliness token whose key ends in the place.

So Prometheus' targets come and go with the processes, and nothing is said again and again.
"""

from __future__ import annotations

import re
import socket
from contextlib import suppress

from swarm.errors import TransportError
from swarm.http.hosts import is_loopback
from swarm.process import SwarmSettings
from swarm.session import Session
from swarm.trust.roles import Role

PLACE = re.compile(
    r"(?P<scheme>https?):(?P<address>(\[[0-9a-fA-F:]{2,45}\]|[A-Za-z0-9._-]{1,253}):\d{1,5})"
)
"""As it stands in the key: `http:10.0.0.7:9101`."""
_NAMED = re.compile(r"(?P<host>\[[^]]+\]|[^:]+)(:(?P<port>\d+))?")
_ANYWHERE = ("", "0.0.0.0", "::")


def announce(session: Session, settings: SwarmSettings, role: Role, port: int) -> None:
    """Shows where the metrics of a role are, until the session ends; nothing where nobody else
    could reach them. `port`: the one that is bound."""
    place = place_of(settings, port)
    if place:
        # Without a session any more, the process is about to end.
        with suppress(TransportError):
            session.declare_metrics(role.common_name, place)


def place_of(settings: SwarmSettings, port: int) -> str:
    """Where the metrics of a process are reached; empty where they only are from its own host and
    the router is on another one."""
    scheme = "https" if settings.metrics_tls else "http"
    if named := _NAMED.fullmatch(settings.metrics_address):
        return f"{scheme}:{named['host']}:{named['port'] or port}"
    router = _host_of(settings.router)
    if settings.metrics_host not in _ANYWHERE:
        near = not router or is_loopback(router)
        unreachable = is_loopback(settings.metrics_host) and not near
        return "" if unreachable else f"{scheme}:{bracketed(settings.metrics_host)}:{port}"
    own = _way_to(router) if router else "127.0.0.1"
    return f"{scheme}:{bracketed(own)}:{port}" if own else ""


def _host_of(router: str) -> str:
    """Of `tcp/HOST:PORT#...`; empty for a Unix socket."""
    protocol, _, rest = router.partition("/")
    if protocol.startswith("unix"):
        return ""
    return rest.partition("#")[0].partition("?")[0].rpartition(":")[0].strip("[]")


def _way_to(host: str) -> str:
    """This host's own address on the way to another one; empty where there is none. Nothing is
    sent."""
    try:
        found = socket.getaddrinfo(host, 9, type=socket.SOCK_DGRAM)
        family, kind, _, _, address = found[0]
        with socket.socket(family, kind) as probe:
            probe.connect(address)
            return str(probe.getsockname()[0])
    except (OSError, IndexError):
        return ""


def bracketed(host: str) -> str:
    """A host name or address as it stands before a port."""
    return f"[{host}]" if ":" in host else host
