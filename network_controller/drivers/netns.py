"""Links of a swarm in network namespaces: the controller lives in the bridge's namespace."""

from __future__ import annotations

import json
import os
import socket
import subprocess
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from network_controller.drivers import shaping
from network_controller.drivers.command import attempt, run
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

    def __init__(self, swarm: str, bridge: str = BRIDGE, namespaces: Path = NAMESPACES) -> None:
        """The namespaces hold one swarm only; its name is of no matter here."""
        self.swarm = swarm
        self._bridge = bridge
        self._namespaces = namespaces
        self._shaper = shaping.Shaper()
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
        self._shaper.apply(port.device, link.direction, shape)

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
            for device in shaping.orphans([port.device for port in self._find().values()]):
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
            if robot in names and _index(port.device) == port.index
        }
        if names - known.keys():
            shown = json.loads(run("ip", "-j", "link", "show", "master", self._bridge) or "[]")
            by_index = {one["ifindex"]: one["ifname"] for one in shown if "ifindex" in one}
            for robot in sorted(names - known.keys()):
                port = self._look(robot, by_index)
                if port is not None:
                    known[robot] = port
        self._ports = known
        return known

    def _look(self, robot: str, bridge_ports: Mapping[int, str]) -> _Port | None:
        """A robot's link, found from the robot's end: the kernel knows the other end's index."""
        done = attempt("ip", "-n", robot, "-j", "-4", "addr", "show", "dev", INSIDE)
        if done.returncode != 0 or not done.stdout.strip():
            return None
        (inside, *_) = json.loads(done.stdout)
        device = bridge_ports.get(inside.get("link_index", 0))
        addresses = inside.get("addr_info", [])
        if device is None or not addresses:
            return None
        return _Port(device, inside["link_index"], addresses[0]["local"])


def _index(device: str) -> int:
    try:
        return socket.if_nametoindex(device)
    except OSError:
        return 0
