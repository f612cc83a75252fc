"""Looking for routers on the local network by multicast, where a site allows that.

Anybody on that network may answer. Whom a secure swarm's processes then talk to, its certificate
decides; so this finds an address and proves nothing.
"""

from __future__ import annotations

import json
import re
import socket
import time
from collections.abc import Iterable

import zenoh

from swarm.errors import SettingError

SCOUT_S = 3.0
_LOCATOR = re.compile(r"(?P<protocol>tcp|tls)/(?P<host>\[[^\]]+\]|[^:/\s]+):(?P<port>\d+)")


def find_router(protocol: str, timeout_s: float = SCOUT_S) -> str:
    """The router that answers, `tls/HOST:PORT`; of several the one of this machine.

    Raises SettingError where none answers, or several do and none of them is here.
    """
    found = places(_answers(timeout_s), protocol)
    here = [place for place in found if _is_here(place)]
    if len(here or found) == 1:
        return (here or found)[0]
    if not found:
        raise SettingError(
            f"no router answers on this network by multicast within {timeout_s:g} s, at least none "
            f"by {protocol}: `coadapt router --scouting` does where it is allowed; else name one, "
            f"{protocol}/HOST:PORT"
        )
    raise SettingError(f"several routers answer, name one of them: {', '.join(here or found)}")


def places(locators: Iterable[str], protocol: str) -> list[str]:
    """The routers of some locators, each of which has a port a traffic class: its first one.

    >>> places(["tls/10.0.0.1:7448?prio=4-5", "tls/10.0.0.1:7447?prio=1-3"], "tls")
    ['tls/10.0.0.1:7447']
    """
    first: dict[str, int] = {}
    for locator in locators:
        match = _LOCATOR.match(locator)
        if match is not None and match["protocol"] == protocol:
            port = int(match["port"])
            first[match["host"]] = min(port, first.get(match["host"], port))
    return sorted(f"{protocol}/{host}:{port}" for host, port in first.items())


def _answers(timeout_s: float) -> list[str]:
    config = {"mode": "client", "scouting": {"multicast": {"enabled": True}}}
    scout = zenoh.scout(what="router", config=zenoh.Config.from_json5(json.dumps(config)))
    time.sleep(timeout_s)
    found: list[str] = []
    while (hello := scout.try_recv()) is not None:
        found += map(str, hello.locators)
    scout.stop()  # type: ignore[no-untyped-call]
    return found


def _is_here(place: str) -> bool:
    """Whether an address is this machine's own."""
    match = _LOCATOR.match(place)
    if match is None:
        return False
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((match["host"], 0))
    except OSError:
        return False
    return True
