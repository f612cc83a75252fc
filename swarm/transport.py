"""Zenoh configuration of routers and clients, and opening a session with it."""

from __future__ import annotations

import json
import re
import threading
from typing import Any

import zenoh

from swarm.errors import SettingError, TransportError
from swarm.traffic import LINKS, TrafficClass

_TCP = re.compile(r"tcp/(?P<host>\[[^\]]+\]|[^:/\s]+):(?P<port>\d{1,5})")
_UNIX = re.compile(r"unixsock-stream/(?P<path>/\S+)")
MAX_UNIX_PATH = 100
RETRY_S = 0.5

_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/unicast/max_links": LINKS + 1,
    # Shared memory does not cross containers, and promotes payloads silently.
    "transport/shared_memory/enabled": False,
}


def router_config(host: str, port: int, unix_socket: str | None = None) -> dict[str, Any]:
    """Settings of a router that listens with one port a traffic class from `port` on.

    Keys are Zenoh's configuration paths; `router_json5` writes them as `zenohd` reads them.
    """
    listen = [cls.endpoint(host, port) for cls in TrafficClass]
    if unix_socket is not None:
        if len(unix_socket.encode()) > MAX_UNIX_PATH:
            raise SettingError(
                f"unix socket path {unix_socket!r} is longer than {MAX_UNIX_PATH} bytes; "
                "choose a shorter run directory"
            )
        listen.append(f"unixsock-stream/{unix_socket}")
    return {"mode": "router", "listen/endpoints": listen, **_COMMON}


def client_config(router: str) -> dict[str, Any]:
    """Settings of a client of the router at `tcp/HOST:PORT` or `unixsock-stream/PATH`.

    Raises SettingError for another form.
    """
    tcp = _TCP.fullmatch(router)
    if tcp and 0 < int(tcp["port"]) <= 65535 - LINKS:
        locators = [cls.endpoint(tcp["host"], int(tcp["port"])) for cls in TrafficClass]
        connect: list[Any] = [{"strategy": "allOf", "locators": locators}]
    elif _UNIX.fullmatch(router):
        connect = [router]
    else:
        raise SettingError(
            f"router {router!r} is not valid; it must be tcp/HOST:PORT or unixsock-stream/PATH"
        )
    return {"mode": "client", "connect/endpoints": connect, **_COMMON}


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


def open_zenoh(
    config: dict[str, Any],
    *,
    timeout_s: float | None = None,
    stop: threading.Event | None = None,
) -> zenoh.Session:
    """Opens a session; a client tries again every half second until its router is there.

    Args:
        config: settings by Zenoh's configuration path.
        timeout_s: give up after this long; None tries until `stop` is set.
        stop: ends the attempts.

    Raises:
        TransportError: the session could not be opened in time, or `stop` was set first.
    """
    stop = stop or threading.Event()
    waited = 0.0
    while True:
        settings = zenoh.Config.from_json5(json.dumps(nested(config)))
        try:
            return zenoh.open(settings)
        except zenoh.ZError as error:
            where = config.get("connect/endpoints") or config.get("listen/endpoints")
            if config["mode"] != "client" or (timeout_s is not None and waited >= timeout_s):
                raise TransportError(f"cannot open a Zenoh session at {where}: {error}") from error
            if stop.wait(RETRY_S):
                raise TransportError(f"stopped before {where} could be reached") from error
            waited += RETRY_S
