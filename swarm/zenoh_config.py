"""How routers and clients of a swarm configure Zenoh."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swarm import traffic
from swarm.defaults import ROUTER_PORT
from swarm.errors import IdentityError, SettingError
from swarm.messages import MAX_MESSAGE_BYTES
from swarm.traffic import LINKS, TrafficClass
from swarm.trust.identity import Identity
from swarm.trust.members import Trust

_TCP = re.compile(
    r"(?P<protocol>tcp|tls)/(?P<host>\[[^\]]+\]|[^:/\s]+):(?P<port>\d{1,5})"
    r"(#identity=(?P<identity>/.+))?"
)
_UNIX = re.compile(r"(?P<locator>unixsock-stream/[^\s#]+)(#identity=(?P<identity>/.+))?")
MAX_UNIX_PATH = 100
WAIT_BEFORE_CLOSE_US = 10_000_000
"""How long a link may take no message before its transport is closed: as long as Zenoh's lease,
after which a silent peer counts as gone. The wait is for one batch (`swarm.chunks` sends nothing
larger), 0.5 s at 1 Mbit/s; the rest is for TCP, which may stand still for seconds when a rate
collapses and a full queue is lost."""

REACH_MS = 2_000
"""How long a router waits for another one at one try. Zenoh tries a peer's links one after the
other, and TCP asks a silent address after 1, 2 and 3 seconds again, then ever more rarely: with
Zenoh's 10 s a cable that is back is found only up to ten seconds later."""

CONTROL_BUFFER_BYTES = 16_384
"""What a router's socket holds of control traffic on its way to one process. Left to itself the
kernel takes megabytes: minutes of old news before a link that has become narrow."""

MAX_RECEIVED_BYTES = MAX_MESSAGE_BYTES + 1_000_000
"""What Zenoh puts together at most: a message, its key and its attachment. A sender of more loses
its connection before the memory is spent, here and at the router."""

CONTROL_BYTES = {
    "coadapt/*/robot/*/beacon/**": 16_384,
    "coadapt/*/robot/*/scene/**": 262_144,
    "coadapt/*/net/**": 1_048_576,
}
"""What a router passes on at most, by key: many times what the largest swarm says there. Everybody
who listens would have to take more."""

_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/unicast/max_links": LINKS + 1,
    # Shared memory does not cross containers, and promotes payloads silently.
    "transport/shared_memory/enabled": False,
    "transport/link/rx/max_message_size": MAX_RECEIVED_BYTES,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": WAIT_BEFORE_CLOSE_US,
}


_FOUND: dict[str, Any] = {
    "scouting/multicast/enabled": True,
    # It answers, and connects to nobody whom it finds itself.
    "scouting/multicast/autoconnect": {"router": [], "peer": [], "client": []},
}


def router_config(
    host: str,
    port: int,
    unix_socket: str | None = None,
    trust: Trust | None = None,
    peers: Sequence[str] = (),
    *,
    scouting: bool = False,
) -> dict[str, Any]:
    """Settings of a router that listens with one port a traffic class from `port` on.

    With `trust` it shows its certificate, lets in nobody without one, and everybody may do only
    what `trust` allows. `peers` are routers of other machines, `tls/HOST:PORT` (without `trust`
    `tcp/HOST:PORT`), which it goes on to connect to. With `scouting` it answers who looks for a
    router by multicast. Keys are Zenoh's configuration paths;
    `router_json5` writes them as `zenohd` reads them. Raises SettingError.
    """
    small = {TrafficClass.CONTROL: f";so_sndbuf={CONTROL_BUFFER_BYTES}"}
    protocol: traffic.Protocol = "tcp" if trust is None else "tls"
    listen = [cls.endpoint(host, port, protocol) + small.get(cls, "") for cls in TrafficClass]
    if unix_socket is not None:
        if len(unix_socket.encode()) > MAX_UNIX_PATH:
            raise SettingError(
                f"unix socket path {unix_socket!r} is longer than {MAX_UNIX_PATH} bytes; "
                "choose a shorter run directory"
            )
        listen.append(f"unixsock-stream/{unix_socket}")
    filters = [
        {
            "id": key.replace("*", "any").replace("/", "-"),
            "flows": ["ingress"],
            "messages": ["put"],
            "key_exprs": [key],
            "size_limit": size,
        }
        for key, size in CONTROL_BYTES.items()
    ]
    return {
        "mode": "router",
        "listen/endpoints": listen,
        "low_pass_filter": filters,
        **(_trusting(trust) if trust is not None else {}),
        **(_meshed(peers, protocol) if peers else {}),
        **_COMMON,
        **(_FOUND if scouting else {}),
    }


def _meshed(peers: Sequence[str], protocol: traffic.Protocol) -> dict[str, Any]:
    """Connections to other routers, one link a traffic class, that are tried again for ever."""
    connect = []
    for peer in peers:
        found = _TCP.fullmatch(peer)
        if found is None or found["protocol"] != protocol or found["identity"]:
            raise SettingError(f"peer {peer!r} is not valid; it must be {protocol}/HOST:PORT")
        connect.append(_all_of(found["host"], int(found["port"]), protocol))
    return {
        "connect/endpoints": connect,
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "transport/unicast/open_timeout": REACH_MS,
        "connect/retry": {
            "period_init_ms": 500,
            "period_max_ms": 1000,
            "period_increase_factor": 1.5,
        },
    }


def _all_of(host: str, port: int, protocol: traffic.Protocol) -> dict[str, Any]:
    locators = [cls.endpoint(host, port, protocol) for cls in TrafficClass]
    return {"strategy": "allOf", "locators": locators}


def _trusting(trust: Trust) -> dict[str, Any]:
    return {
        "transport/link/tls/root_ca_certificate": str(trust.identity.ca),
        "transport/link/tls/listen_certificate": str(trust.identity.certificate),
        "transport/link/tls/listen_private_key": str(trust.identity.key),
        "transport/link/tls/connect_certificate": str(trust.identity.certificate),
        "transport/link/tls/connect_private_key": str(trust.identity.key),
        "transport/link/tls/verify_name_on_connect": True,
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/close_link_on_expiration": True,
        "access_control": trust.access,
    }


def client_config(router: str) -> dict[str, Any]:
    """Settings of a client of the router at `tcp/HOST:PORT`, at `tls/HOST:PORT#identity=FOLDER`
    (an absolute path of an `identity.Identity`), or at `unixsock-stream/PATH` (of a secure swarm,
    with `#identity=FOLDER`, too).

    Raises SettingError for another form.
    """
    tcp = _TCP.fullmatch(router)
    secured: dict[str, Any] = {}
    if (
        tcp
        and 0 < int(tcp["port"]) <= 65535 - LINKS
        and (tcp["protocol"] == "tls") == (tcp["identity"] is not None)
    ):
        protocol: traffic.Protocol = "tls" if tcp["identity"] else "tcp"
        connect: list[Any] = [_all_of(tcp["host"], int(tcp["port"]), protocol)]
        if (identity := identity_of(router)) is not None:
            secured = {
                "transport/link/tls/root_ca_certificate": str(identity.ca),
                "transport/link/tls/connect_certificate": str(identity.certificate),
                "transport/link/tls/connect_private_key": str(identity.key),
                "transport/link/tls/enable_mtls": True,
                "transport/link/tls/verify_name_on_connect": True,
                "transport/link/tls/close_link_on_expiration": True,
            }
    elif local := _UNIX.fullmatch(router):
        connect = [local["locator"]]
    else:
        raise SettingError(
            f"router {router!r} is not valid; it must be tcp/HOST:PORT, "
            "tls/HOST:PORT#identity=FOLDER or unixsock-stream/PATH[#identity=FOLDER]"
        )
    return {"mode": "client", "connect/endpoints": connect, **secured, **_COMMON}


def with_port(place: str) -> str:
    """A router's address with the usual port where it names none.

    >>> with_port("tls/10.0.0.1")
    'tls/10.0.0.1:7447'
    """
    return place if re.search(r":\d+$", place) else f"{place}:{ROUTER_PORT}"


def identity_of(router: str) -> Identity | None:
    """As whom a client takes part in a secure swarm: what stands behind `#identity=` in the
    router's address. None where nothing does. Over a Unix socket no certificate is shown."""
    found = _TCP.fullmatch(router) or _UNIX.fullmatch(router)
    return Identity(Path(found["identity"])) if found and found["identity"] else None


def nested(config: dict[str, Any]) -> dict[str, Any]:
    """The same settings as the nested object of a configuration file."""
    tree: dict[str, Any] = {}
    for path, value in config.items():
        *parents, leaf = path.split("/")
        node = tree
        for parent in parents:
            node = node.setdefault(parent, {})
        node[leaf] = value
    return tree


def router_json5(config: dict[str, Any]) -> str:
    """A configuration file for `zenohd -c FILE` (JSON is JSON5)."""
    return json.dumps(nested(config), indent=2) + "\n"


def expected_links(config: dict[str, Any]) -> int:
    """How many links a client with this configuration has when all are up."""
    (endpoint,) = config["connect/endpoints"]
    return len(endpoint["locators"]) if isinstance(endpoint, dict) else 1


def check_router(router: str, role: str) -> None:
    """Raises SettingError for a router that cannot be one, and IdentityError where this process
    could not show itself there as `role`, a certificate's common name."""
    client_config(router)
    identity = identity_of(router)
    if identity is None:
        return
    if identity.name != role:
        raise IdentityError(
            f"router {router!r} names the identity of {identity.name!r}, and this process is "
            f"{role!r}; `coadapt certs issue {role}` makes one"
        )
    check_identity(identity)


def check_identity(identity: Identity) -> None:
    """Raises IdentityError where an identity cannot be shown."""
    # Only here: the library takes 13 MB, which a plain swarm's processes go without.
    from swarm.trust.certificates import check

    check(identity)


def shown_identity(config: dict[str, Any]) -> Identity | None:
    """Whose certificate a client with this configuration shows; over a Unix socket none."""
    certificate = config.get("transport/link/tls/connect_certificate")
    return None if certificate is None else Identity(Path(certificate).parent)
