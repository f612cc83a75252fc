"""Why an interface of the host must be left alone: it is another's, or the host's own way out."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterable, Mapping
from typing import Any

from network_controller.drivers.command import run
from network_controller.drivers.interfaces import index_of

_PARENTS = ("vlan", "macvlan", "ipvlan", "macvtap")
"""Kinds of interface that send through another one, their `link`."""


def refusal(interface: str, confirmed: str, *, own_clsact: bool) -> str:
    """Why an interface is not to be shaped; empty where it may be.

    `confirmed`: the interface that may be shaped though the default route leads through it.
    `own_clsact`: the queueing discipline `clsact` on it is the caller's own. Raises NetworkError
    where nobody can tell.
    """
    if not index_of(interface):
        others = ", ".join(name for _, name in socket.if_nameindex()) or "none"
        return f"there is no interface {interface!r} on this host; there are {others}"
    if interface == "lo":
        return "interface 'lo' is no link: nothing that it carries leaves this host"
    ways = _default_ways(_table("link", "show"))
    if interface in ways and confirmed != interface:
        by = ways[interface]
        through = "" if by == interface else f", by {by}"
        return (
            f"interface {interface} carries this host's default route{through}, so shaping it "
            "could cut the host off; name another one, or confirm it: "
            f"COADAPT_INTERFACE_CONFIRMED={interface}"
        )
    for queue in json.loads(run("tc", "-j", "qdisc", "show", "dev", interface) or "[]"):
        kind, handle = queue["kind"], queue["handle"]
        # The kernel's own have the handle 0.
        if handle != "0:" and not (kind == "clsact" and own_clsact):
            return (
                f"interface {interface} has a qdisc of somebody else's, {kind} {handle}; it is "
                f"left alone. Who needs it no more: tc qdisc del dev {interface} "
                f"{'root' if queue.get('root') else kind}"
            )
    return ""


def _default_ways(links: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """The interfaces through which a default route leads, in whatever table, also below a bridge,
    a bond or a VLAN; and by which interface it does."""
    ways: dict[str, str] = {}
    for family in ("-4", "-6"):
        for route in json.loads(
            run("ip", "-j", family, "route", "show", "table", "all", "default") or "[]"
        ):
            for hop in (route, *route.get("nexthops", ())):
                if "dev" in hop:
                    ways.setdefault(hop["dev"], hop["dev"])
    todo = list(ways)
    while todo:
        upper = todo.pop()
        for link in links:
            name = link["ifname"]
            below = [name] if link.get("master") == upper else []
            if name == upper and link.get("linkinfo", {}).get("info_kind") in _PARENTS:
                below.append(link.get("link", ""))
            for one in below:
                if one and one not in ways:
                    ways[one] = ways[upper]
                    todo.append(one)
    return ways


def _table(*what: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(run("ip", "-j", "-d", *what) or "[]")
    return found
