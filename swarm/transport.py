"""Zenoh configuration of routers and clients, and opening a session with it."""

from __future__ import annotations

import json
import math
import re
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

import zenoh

from swarm import traffic
from swarm.defaults import ROUTER_PORT
from swarm.errors import IdentityError, SettingError, TransportError
from swarm.messages import MAX_MESSAGE_BYTES
from swarm.reaching import why_not
from swarm.traffic import LINKS, TrafficClass
from swarm.trust.identity import Identity
from swarm.trust.members import Trust

_TCP = re.compile(
    r"(?P<protocol>tcp|tls)/(?P<host>\[[^\]]+\]|[^:/\s]+):(?P<port>\d{1,5})"
    r"(#identity=(?P<identity>/.+))?"
)
_UNIX = re.compile(r"(?P<locator>unixsock-stream/[^\s#]+)(#identity=(?P<identity>/.+))?")
MAX_UNIX_PATH = 100
RETRY_S = 0.5
FIRST_TELL_S, TELL_S = 2.0, 10.0
"""When, and how often, a process that waits for its router says why."""
POLL_S = 0.1

CLOSE_S = 1.2
"""Under loss Zenoh may hold a closing session for ten seconds; a process must not wait for it."""


class Entity(Protocol):
    """What Zenoh declares: a subscriber, a queryable or a liveliness token."""

    def undeclare(self) -> Any:
        """Withdraws it."""


WAIT_BEFORE_CLOSE_US = 10_000_000
"""How long a link may take no message before its transport is closed: as long as Zenoh's lease,
after which a silent peer counts as gone. The wait is for one batch (`swarm.chunks` sends nothing
larger), 0.5 s at 1 Mbit/s; the rest is for TCP, which may stand still for seconds when a rate
collapses and a full queue is lost."""

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


def open_zenoh(
    config: dict[str, Any],
    *,
    timeout_s: float | None = None,
    stop: threading.Event | None = None,
    on_wait: Callable[[str], object] | None = None,
) -> zenoh.Session:
    """Opens a session; a client tries again every half second until its router is there.

    Args:
        config: settings by Zenoh's configuration path.
        timeout_s: give up after this long; None tries until `stop` is set.
        stop: ends the attempts.
        on_wait: hears every TELL_S, on a thread of its own, why the router cannot be reached.

    Raises:
        TransportError: the session could not be opened in time, or `stop` was set first.
        IdentityError: this process has no certificate that it could show.
    """
    stop = stop or threading.Event()
    deadline = math.inf if timeout_s is None else time.monotonic() + timeout_s
    where = config.get("listen/endpoints") or config.get("connect/endpoints")
    failure: zenoh.ZError | None = None
    waiting = _Waiting(config, on_wait)
    while True:
        attempt: Future[zenoh.Session] = Future()
        # On a thread of its own: where packets vanish, an attempt lasts as long as TCP tries.
        threading.Thread(target=_open, args=(config, attempt), name="open", daemon=True).start()
        try:
            return _wait(attempt, deadline, stop, waiting)
        except zenoh.ZError as error:
            _check_identity(config)
            failure = error
            if config["mode"] != "client" or time.monotonic() >= deadline:
                raise _cannot(where, failure, config) from error
        except TimeoutError as error:
            if not stop.is_set() and failure is not None:
                # How an earlier attempt ended says more than that this one has not.
                raise _cannot(where, failure, config) from failure
            if not stop.is_set():
                raise TransportError(f"no answer from {where} within {timeout_s} s") from error
        if stop.wait(RETRY_S):
            raise TransportError(f"stopped before {where} could be reached")


class _Waiting:
    """Tells now and then why a router cannot be reached."""

    def __init__(self, config: dict[str, Any], on_wait: Callable[[str], object] | None) -> None:
        self._config = config
        self._on_wait = on_wait
        self._due = time.monotonic() + FIRST_TELL_S

    def look(self) -> None:
        """Tells, where that is due; takes no time itself."""
        if self._on_wait is None or time.monotonic() < self._due:
            return
        self._due = time.monotonic() + TELL_S
        threading.Thread(target=self._tell, name="reaching", daemon=True).start()

    def _tell(self) -> None:
        assert self._on_wait is not None
        self._on_wait(_why_not(self._config) or "it does not answer")


def _why_not(config: dict[str, Any]) -> str:
    """Why a client's router cannot be reached, as far as that can be found out."""
    connect = config.get("connect/endpoints")
    if config["mode"] != "client" or not connect or not isinstance(connect[0], dict):
        return ""
    return why_not(connect[0]["locators"][0], shown_identity(config))


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
    _check(identity)


def _check(identity: Identity) -> None:
    # Only here: the library takes 13 MB, which a plain swarm's processes go without.
    from swarm.trust.certificates import check

    check(identity)


def _cannot(where: object, failure: zenoh.ZError, config: dict[str, Any]) -> TransportError:
    why = _why_not(config)
    told = f"{failure}: {why}" if why else f"{failure}{_hint(config)}"
    return TransportError(f"cannot open a Zenoh session at {where}: {told}")


def _hint(config: dict[str, Any]) -> str:
    """What else may be wrong where a router does not take a client: it does not say."""
    if config["mode"] != "client":
        return ""
    identity = shown_identity(config)
    if identity is not None:
        return (
            f". Where the router runs: {identity.ca} may be another swarm's authority, or the "
            "router's certificate of another address"
        )
    if "tcp/" in str(config["connect/endpoints"]):
        return ". Where the router runs: a secure one wants tls/HOST:PORT#identity=FOLDER"
    return ""


def shown_identity(config: dict[str, Any]) -> Identity | None:
    """Whose certificate a client with this configuration shows; over a Unix socket none."""
    certificate = config.get("transport/link/tls/connect_certificate")
    return None if certificate is None else Identity(Path(certificate).parent)


def _check_identity(config: dict[str, Any]) -> None:
    """Raises IdentityError where that is why a session could not be opened."""
    identity = shown_identity(config)
    if identity is not None:
        _check(identity)


def close_zenoh(
    session: zenoh.Session, entities: Iterable[Entity] = (), patience_s: float = CLOSE_S
) -> None:
    """Withdraws the entities and closes; waits no longer than `patience_s`, and lets it go on.

    Queryables go with the session: where two sessions serve one key and one of them withdraws it,
    a router of Zenoh 1.10 sends the questions to neither until somebody else connects.
    """

    def work() -> None:
        # What is closed already needs no closing.
        with suppress(zenoh.ZError):
            for entity in entities:
                if not isinstance(entity, zenoh.Queryable):
                    entity.undeclare()
            session.close()  # type: ignore[no-untyped-call]

    thread = threading.Thread(target=work, name="close", daemon=True)
    thread.start()
    thread.join(patience_s)


def _open(config: dict[str, Any], attempt: Future[zenoh.Session]) -> None:
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(nested(config))))
    except zenoh.ZError as error:
        if attempt.set_running_or_notify_cancel():
            attempt.set_exception(error)
        return
    if attempt.set_running_or_notify_cancel():
        attempt.set_result(session)
    else:
        session.close()  # type: ignore[no-untyped-call]


def _wait(
    attempt: Future[zenoh.Session], deadline: float, stop: threading.Event, waiting: _Waiting
) -> zenoh.Session:
    """The session of an attempt. Raises ZError when it fails, TimeoutError when it is given up."""
    while True:
        waiting.look()
        try:
            return attempt.result(POLL_S)
        except TimeoutError:
            if (stop.is_set() or time.monotonic() >= deadline) and attempt.cancel():
                raise
