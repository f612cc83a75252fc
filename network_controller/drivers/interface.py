"""Links on an interface of the host that the operator names: robots by their addresses.

    eth1 ── clsact ── a packet to or from a robot's address ──► its `ifb`, with the HTB ──► eth1

The interface keeps its own queue, and what is of no named robot passes as before. A robot whose
address is this host's sends `up` and receives `down`; of one beyond it is the other way round.
"""

from __future__ import annotations

import hashlib
import ipaddress
import json
import re
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated

import msgspec

from network_controller.drivers import shaping, traces
from network_controller.drivers.base import Running
from network_controller.drivers.command import attempt, run
from network_controller.drivers.interfaces import index_of
from network_controller.drivers.readings import read_devices
from network_controller.drivers.refusals import refusal
from network_controller.drivers.traces import Traces
from network_controller.model import (
    DIRECTIONS,
    Capabilities,
    Link,
    LinkReading,
    LinkShape,
    Queue,
    lacking,
)
from swarm.errors import LinkGoneError, NetworkError, SettingError
from swarm.settings import load

LOOK_S = 5.0
"""Between looks whether the interface may still be shaped."""
FIRST_PREFERENCE = 47_001
"""Of our filters, one a robot."""
STATE = "/run/coadapt/{swarm}.interface.json"
"""The kernel forgets shapes when the machine ends, and so does this folder."""
_SRC, _DST = 12, 16
"""Where an IPv4 header has its addresses."""
_HOOK = re.compile(
    r"match ([0-9a-f]{8})/ffffffff at (\d+).*\n\s*action order 1: mirred "
    r"\(Egress Redirect to device (\S+?)\)"
)
_Robot = Annotated[
    str,
    msgspec.Meta(
        pattern=r"^[A-Za-z0-9_-]{1,32}(=[0-9.]{7,15})?(?!\n)$",
        description="a robot's id, or id=IPv4 address",
    ),
]


class InterfaceSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Which interface, and whose links it carries."""

    interface: Annotated[
        str, msgspec.Meta(pattern=r"^[^\s/]{1,15}$", description="the name of an interface")
    ]
    interface_robots: Annotated[tuple[_Robot, ...], msgspec.Meta(min_length=1, max_length=1024)]
    """`R7=10.0.0.7`; without an address the robot has the interface's own."""
    interface_confirmed: str = ""
    """The same name again, where the default route leads through the interface."""
    interface_state: str = ""
    """File that tells what was put on it; empty: STATE."""


class InterfaceDriver:
    """Robots are the settings'; each direction of each has an `ifb` device with its HTB."""

    name = "interface"
    one_tree = False

    def __init__(self, swarm: str) -> None:
        """Raises SettingError where the settings do not say which interface, or which robots."""
        settings = load(InterfaceSettings)
        self._interface = settings.interface
        self._confirmed = settings.interface_confirmed
        self._named = _robots(settings.interface_robots)
        self._traces = Traces(Path(settings.interface_state or STATE.format(swarm=swarm)))
        self._shaper = shaping.Shaper(swarm)
        self._found: dict[str, str] = {}
        self._here: frozenset[str] = frozenset()
        self._refused = ""
        self._look_due = 0.0

    def robots(self) -> Mapping[str, str]:
        """See `Driver.robots`; also while they cannot be shaped, so that requests are told why."""
        shown = json.loads(attempt("ip", "-j", "-4", "addr").stdout or "[]")
        own = {
            address["local"]: one["ifname"] for one in shown for address in one.get("addr_info", ())
        }
        first = next((a for a, device in own.items() if device == self._interface), "")
        self._found = {robot: address or first for robot, address in self._named.items()}
        self._here = frozenset(own)
        return dict(self._found)

    def capabilities(self) -> Capabilities:
        """See `Driver.capabilities`. Raises NetworkError also for an interface that is to be left
        alone."""
        found = self._shaper.capabilities()
        if missing := lacking(found):
            raise NetworkError(missing[0])
        self._check(again=True)
        return found

    def apply(self, link: Link, shape: LinkShape) -> None:
        """See `Driver.apply`."""
        self._check(again=time.monotonic() >= self._look_due)
        address = self._address(link)
        if not self._traces.began(self._interface):
            self._traces.remove()
            self._traces.begin(self._interface)
        device = self._device(link)
        before = link in self.read([link])
        try:
            if not before:
                self._make(device, link)
            self._shaper.apply(device, "down", shape)
            if not before:
                self._hook(link, device, address)
        except NetworkError:
            if not before:
                self.clear(link)
            raise

    def read(self, links: Collection[Link]) -> Mapping[Link, LinkReading]:
        """See `Driver.read`."""
        try:
            self._check(again=time.monotonic() >= self._look_due)
        except NetworkError:
            return {}  # Who applies is told why.
        names = {self._device(link): link for link in links if self._found.get(link.robot)}
        if not names or not self._traces.began(self._interface):
            return {}
        show = "".join(f"filter show dev {self._interface} {way}\n" for way in traces.WAYS)
        seen = read_devices(sorted(names), show)
        hooked = {(value, int(at), device) for value, at, device in _HOOK.findall(seen.text)}
        return {
            link: seen.readings[Queue(device)]
            for device, link in names.items()
            if Queue(device) in seen.readings and (*self._match(link), device) in hooked
        }

    def clear(self, link: Link) -> None:
        """See `Driver.clear`. With the last link, all that was put on the interface goes."""
        device = self._device(link)
        others = [one for one in traces.ours(self._interface) if one != device]
        if not others:
            self._traces.remove()
            return
        self._unhook(link)
        attempt("ip", "link", "del", device)
        if index_of(device):
            raise NetworkError(f"ip does not remove {device}, the queue of {link}")

    def shaped(self) -> frozenset[Link]:
        """See `Driver.shaped`; nothing of an earlier controller, which was taken away."""
        return frozenset(
            self.read([Link(robot, way) for robot in self._named for way in DIRECTIONS])
        )

    def start_at(self, robot: str, argv: list[str]) -> Running:
        """See `Driver.start_at`: nothing can be, for a robot beyond is another machine's."""
        raise NetworkError(
            f"no telemetry can be sent towards {robot}: over interface {self._interface} nothing "
            "can be started at a robot"
        )

    def close(self) -> None:
        """Leaves the interface as it was."""
        self._traces.remove()
        self._traces.close()

    def _check(self, *, again: bool) -> None:
        """Raises NetworkError while the interface is to be left alone; what was put on it is taken
        away then."""
        if again:
            self._traces.open()
            own = self._traces.began(self._interface)
            self._refused = refusal(self._interface, self._confirmed, own_clsact=own)
            self._look_due = time.monotonic() + LOOK_S
            if self._refused:
                self._traces.remove()
        if self._refused:
            raise NetworkError(self._refused)

    def _address(self, link: Link) -> str:
        self.robots()
        address = self._found.get(link.robot)
        if address is None:
            raise LinkGoneError(
                f"robot {link.robot!r} is none of interface {self._interface}'s; "
                f"COADAPT_INTERFACE_ROBOTS names {', '.join(self._named)}"
            )
        if not address:
            raise NetworkError(
                f"interface {self._interface} has no IPv4 address, which robot {link.robot!r} "
                f"would have; name one: COADAPT_INTERFACE_ROBOTS={link.robot}=ADDRESS"
            )
        return address

    def _match(self, link: Link) -> tuple[str, int]:
        """The value and place of the address by which a link's packets are told."""
        address = int(ipaddress.IPv4Address(self._found[link.robot]))
        return f"{address:08x}", _DST if link.direction == "down" else _SRC

    def _way(self, link: Link) -> str:
        here = self._found.get(link.robot) in self._here
        return traces.WAYS[(link.direction == "down") == here]

    def _device(self, link: Link) -> str:
        digest = hashlib.blake2s(f"{self._interface}/{link}".encode(), digest_size=5)
        return f"cif{digest.hexdigest()}"

    def _make(self, device: str, link: Link) -> None:
        if not index_of(device):
            alias = traces.alias_of(self._interface, str(link))
            # By one process, so that none is left behind that nobody knows whose it is.
            lines = f"link add {device} type ifb\nlink set {device} alias '{alias}' up\n"
            run("ip", "-batch", "-", text=lines)

    def _hook(self, link: Link, device: str, address: str) -> None:
        """Sends a link's packets through its device."""
        self._unhook(link)
        side = "dst" if link.direction == "down" else "src"
        run(
            *("tc", "filter", "add", "dev", self._interface, self._way(link), "protocol", "ip"),
            *("pref", self._preference(link), "u32", "match", "ip", side, f"{address}/32"),
            *("action", "mirred", "egress", "redirect", "dev", device),
        )

    def _unhook(self, link: Link) -> None:
        """In both ways: the robot's address may have become this host's."""
        for way in traces.WAYS:
            shown = attempt("tc", "filter", "show", "dev", self._interface, way).stdout
            if self._device(link) in shown:
                pref = ("pref", self._preference(link))
                run("tc", "filter", "del", "dev", self._interface, way, *pref)

    def _preference(self, link: Link) -> str:
        place = 2 * list(self._named).index(link.robot) + (link.direction == "up")
        return str(FIRST_PREFERENCE + place)


def _robots(named: tuple[str, ...]) -> dict[str, str]:
    """Addresses by robot; empty where it is to be the interface's own."""
    found: dict[str, str] = {}
    for one in named:
        robot, _, address = one.partition("=")
        try:
            if address:
                address = str(ipaddress.IPv4Address(address))
        except ValueError as error:
            raise SettingError(
                f"COADAPT_INTERFACE_ROBOTS: {one!r} is not valid: {error}"
            ) from error
        if robot in found or address in found.values():
            raise SettingError(
                f"COADAPT_INTERFACE_ROBOTS: {one!r} is there twice; a link is a robot's and an "
                "address's, so robots that share an address share one link, named by one of them"
            )
        found[robot] = address
    return found


DRIVERS = (InterfaceDriver,)
