"""Under which names an HTTP endpoint of the swarm may be asked."""

from __future__ import annotations

import ipaddress
from collections.abc import Collection
from typing import Annotated
from urllib.parse import urlsplit

import msgspec

HostName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9.-]{1,253}(?!\n)$")]
HostNames = Annotated[tuple[HostName, ...], msgspec.Meta(max_length=16)]
"""Of a setting: names that an endpoint may be asked for, beside localhost and addresses."""


def is_loopback(host: str) -> bool:
    """Whether a host name or address cannot be reached from elsewhere."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Hosts:
    """The names under which this server may be asked.

    A web page elsewhere can have its own name lead to this address (DNS rebinding), but the
    browser then sends that name. Addresses cannot be made to lead elsewhere.
    """

    def __init__(self, names: Collection[str], *, loopback: bool) -> None:
        """`loopback`: of addresses, only this host's own."""
        self._names = {"localhost", *(name.lower() for name in names)}
        self._loopback = loopback

    def may(self, host: str) -> bool:
        """Whether a `Host` header is one of them; the port does not matter."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in self._names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return address.is_loopback or not self._loopback


OWN = Hosts((), loopback=True)
"""This host's own addresses, and localhost."""
