"""How the places of an HTTP server are shared among those who connect."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable


def origin(host: str) -> str:
    """Who connects from an address: of IPv6 the /64 network, which one machine has to itself.

    >>> origin("2001:db8::7:1"), origin("::ffff:192.0.2.1")
    ('2001:db8::/64', '192.0.2.1')
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:  # a Unix socket's other end has none
        return host
    if isinstance(address, ipaddress.IPv4Address):
        return host
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((int(address) >> 64 << 64, 64)))


def may_stay(newcomer: str, others: Iterable[str], places: int) -> bool:
    """Whether a connection may stay beside `others`, all given by `origin`.

    Nobody may hold more places than are left free: so one origin takes half of them at most, two
    together three quarters, and a newcomer finds one (a dynamic threshold, as switches share a
    buffer among their ports).
    """
    held = total = 1
    for other in others:
        total += 1
        held += other == newcomer
    return held <= places - total
