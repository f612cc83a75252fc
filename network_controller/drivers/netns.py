"""Links of a swarm in network namespaces: the controller lives in the bridge's namespace."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from network_controller.drivers import shaping
from network_controller.drivers.command import attempt, run
from network_controller.drivers.ifbs import orphans
from network_controller.drivers.interfaces import index_of, master_of
from network_controller.drivers.tree import Seat
from network_controller.model import DIRECTIONS, Capabilities, Link, LinkReading, LinkShape
from swarm.errors import LinkGoneError, NetworkError

NAMESPACES = Path("/run/netns")
BRIDGE = "coadapt0"
INSIDE = "eth0"
"""The robot's end of its link."""


@dataclass(frozen=True, slots=True)
class _Port:
    device: str
    index: int
    address: str


class NetnsDriver:
    """Robots are the named namespaces whose `eth0` hangs on the swarm's bridge."""

    name = "netns"
    one_tree = True

    def __init__(self, swarm: str, bridge: str = BRIDGE, namespaces: Path = NAMESPACES) -> None:
        """The namespaces hold one swarm only; its name is of no matter here."""
        self.swarm = swarm
        self._bridge = bridge
        self._namespaces = namespaces
        self._shaper = shaping.Shaper(swarm)
        self._ports: dict[str, _Port] = {}

    def robots(self) -> Mapping[str, str]:
        """See `Driver.robots`."""
        return {robot: port.address for robot, port in self._find().items()}

    def capabilities(self) -> Capabilities:
        """See `Driver.capabilities`."""
        return self._shaper.capabilities()

    def apply(self, link: Link, shape: LinkShape) -> None:
        """See `Driver.apply`."""
        port = self._find().get(link.robot)
        if port is None:
            raise LinkGoneError(
                f"robot {link.robot!r} has no link on bridge {self._bridge}; there are "
                f"{', '.join(sorted(self._ports)) or 'none'}"
            )
        if master_of(port.device) != self._bridge:
            raise NetworkError(
                f"interface {port.device} of robot {link.robot!r} no longer hangs on the swarm's "
                f"bridge {self._bridge}; it is left alone"
            )
        self._shaper.apply(port.device, link.direction, shape, self._seat(port))

    def read(self, links: Collection[Link]) -> Mapping[Link, LinkReading]:
        """See `Driver.read`."""
        ports = self._find()
        places = {(ports[k.robot].device, k.direction): k for k in links if k.robot in ports}
        return {places[place]: found for place, found in shaping.read(list(places)).items()}

    def clear(self, link: Link) -> None:
        """See `Driver.clear`."""
        port = self._find().get(link.robot)
        if port is not None:
            shaping.clear(port.device, link.direction)

    def shaped(self) -> frozenset[Link]:
        """See `Driver.shaped`."""
        ports = self._find()
        return frozenset(self.read([Link(robot, way) for robot in ports for way in DIRECTIONS]))

    def start_at(self, robot: str, argv: list[str]) -> subprocess.Popen[bytes]:
        """See `Driver.start_at`."""
        if robot not in self._find():
            raise LinkGoneError(f"robot {robot!r} has no link on bridge {self._bridge}")
        inside = ["nsenter", f"--net={self._namespaces / robot}", *argv]
        return subprocess.Popen(inside, stdin=subprocess.DEVNULL)

    def close(self) -> None:
        """Removes `ifb` devices whose links are gone."""
        with suppress(NetworkError):
            # What still leads to the tree of the cell must not be lost with it.
            shared = any(link.direction == "down" for link in self.shaped())
            owners = [port.device for port in self._find().values()]
            for device in orphans([*owners, *([self._bridge] if shared else [])]):
                attempt("ip", "link", "del", device)

    def _find(self) -> Mapping[str, _Port]:
        """The robots' links; only those that are new or have changed are looked at."""
        try:
            names = {entry.name for entry in os.scandir(self._namespaces)}
        except OSError:
            names = set()
        known = {
            robot: port
            for robot, port in self._ports.items()
            if robot in names and index_of(port.device) == port.index
        }
        if names - known.keys():
            ends = _host_ends(self._bridge)
            for robot in sorted(names - known.keys()):
                port = _look(robot, ends)
                if port is not None:
                    known[robot] = port
        shaping.forget(
            (port.device, self._seat(port))
            for robot, port in self._ports.items()
            if known.get(robot) != port
        )
        self._ports = known
        return known

    def _seat(self, port: _Port) -> Seat:
        return Seat(self._bridge, port.address)


def _host_ends(bridge: str) -> Mapping[tuple[str, int], tuple[str, int]]:
    """Name and index of the bridge's ports, by the namespace and the index of their other end."""
    shown = attempt("ip", "-j", "link", "show", "master", bridge)
    if shown.returncode != 0:
        return {}
    ids = {
        one.get("id"): one["name"] for one in json.loads(run("ip", "-j", "netns", "list") or "[]")
    }
    return {
        (ids[one["link_netnsid"]], one["link_index"]): (one["ifname"], one["ifindex"])
        for one in json.loads(shown.stdout or "[]")
        if one.get("link_netnsid") in ids
    }


def _look(robot: str, host_ends: Mapping[tuple[str, int], tuple[str, int]]) -> _Port | None:
    """A robot's link, when both ends tell of each other: an index alone may be that of another
    interface in another namespace."""
    done = attempt("ip", "-n", robot, "-j", "-4", "addr", "show", "dev", INSIDE)
    if done.returncode != 0 or not done.stdout.strip():
        return None
    (inside, *_) = json.loads(done.stdout)
    device, index = host_ends.get((robot, inside.get("ifindex", 0)), ("", 0))
    addresses = inside.get("addr_info", [])
    if not device or inside.get("link_index") != index or not addresses:
        return None
    return _Port(device, index, addresses[0]["local"])


DRIVERS = (NetnsDriver,)
