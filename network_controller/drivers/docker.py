"""Links of a swarm in Docker: the controller lives in the host's network namespace.

A container's link is the veth whose index the container itself reads in /sys: seen from the host's
mount namespace that file would show the host's own interfaces. The veth must also hang on the
bridge of the swarm's own network, so that no other interface of the host is ever touched.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from network_controller.drivers import shaping
from network_controller.drivers.command import attempt
from network_controller.drivers.ifbs import orphans
from network_controller.drivers.interfaces import facts_of, index_of, master_of
from network_controller.drivers.tree import Seat
from network_controller.model import DIRECTIONS, Capabilities, Link, LinkReading, LinkShape
from swarm.errors import LinkGoneError, NetworkError

LABEL = "coadapt.swarm"
SERVICE_LABEL = "coadapt.service"
INSIDE = "eth0"
"""A container's end of its link."""
TIMEOUT_S = 10


@dataclass(frozen=True, slots=True)
class _Port:
    container: str
    device: str
    index: int
    bridge: str
    address: str


class _Exec:
    """A program in a container, started through the engine."""

    def __init__(self, api: Any, number: str) -> None:
        self._api = api
        self._number = number

    def poll(self) -> int | None:
        """See `base.Running`."""
        with _faults():
            facts = self._api.exec_inspect(self._number)
        return None if facts["Running"] else int(facts["ExitCode"] or 0)


class DockerDriver:
    """Robots are the swarm's containers: `ego-R1` where there is one, else `robot-R1`."""

    name = "docker"
    one_tree = True

    def __init__(self, swarm: str) -> None:
        """The engine is asked when it is needed first."""
        self.swarm = swarm
        self._shaper = shaping.Shaper(swarm)
        self._engine: Any = None
        self._ports: dict[str, _Port] = {}
        self._refused: dict[str, str] = {}
        """Robots whose link must not be touched, and why."""

    def robots(self) -> Mapping[str, str]:
        """See `Driver.robots`."""
        return {robot: port.address for robot, port in self._find().items()}

    def capabilities(self) -> Capabilities:
        """See `Driver.capabilities`."""
        return self._shaper.capabilities()

    def apply(self, link: Link, shape: LinkShape) -> None:
        """See `Driver.apply`."""
        port = self._find().get(link.robot)
        if link.robot in self._refused:
            raise NetworkError(self._refused[link.robot])
        if port is None:
            raise LinkGoneError(
                f"robot {link.robot!r} has no running container in swarm {self.swarm!r}; there are "
                f"{', '.join(sorted(self._ports)) or 'none'}"
            )
        if master_of(port.device) != port.bridge:
            raise NetworkError(
                f"interface {port.device} of robot {link.robot!r} no longer hangs on the swarm's "
                f"bridge {port.bridge}; it is left alone"
            )
        self._shaper.apply(port.device, link.direction, shape, _seat(port))

    def read(self, links: Collection[Link]) -> Mapping[Link, LinkReading]:
        """See `Driver.read`."""
        # Without asking the engine: an interface that has vanished has no reading.
        ports = self._ports if self._ports else self._find()
        places = {(ports[k.robot].device, k.direction): k for k in links if k.robot in ports}
        return {places[place]: found for place, found in shaping.read(list(places)).items()}

    def clear(self, link: Link) -> None:
        """See `Driver.clear`."""
        # Also when its container is gone: the `ifb` device of its link is still there.
        port = self._ports.get(link.robot) or self._find().get(link.robot)
        if port is not None:
            shaping.clear(port.device, link.direction)

    def shaped(self) -> frozenset[Link]:
        """See `Driver.shaped`."""
        ports = self._find()
        return frozenset(self.read([Link(robot, way) for robot in ports for way in DIRECTIONS]))

    def start_at(self, robot: str, argv: list[str]) -> _Exec:
        """See `Driver.start_at`."""
        port = self._find().get(robot)
        if port is None:
            raise LinkGoneError(f"robot {robot!r} has no running container in {self.swarm!r}")
        with _faults():
            api = self._api()
            number = api.exec_create(port.container, argv)["Id"]
            api.exec_start(number, detach=True)
        return _Exec(api, number)

    def close(self) -> None:
        """Removes `ifb` devices whose links are gone, and lets go of the engine."""
        here = [name for _, name in socket.if_nameindex()]
        with suppress(NetworkError):
            for device in orphans(here):
                attempt("ip", "link", "del", device)
        if self._engine is not None:
            self._engine.close()

    def _api(self) -> Any:
        import docker

        if self._engine is None:
            environment = docker.utils.kwargs_from_env()
            self._engine = docker.APIClient(version="auto", timeout=TIMEOUT_S, **environment)
        return self._engine

    def _find(self) -> Mapping[str, _Port]:
        """The robots' links; only those of new or restarted containers are looked for."""
        with _faults():
            label = f"{LABEL}={self.swarm}"
            listed = self._api().containers(all=True, filters={"label": label})
        known: dict[str, _Port] = {}
        self._refused = {}
        for robot, facts in _by_robot(listed).items():
            port = self._ports.get(robot)
            if port is None or port.container != facts["Id"] or index_of(port.device) != port.index:
                port = self._look(robot, facts)
            if port is not None:
                known[robot] = port
        left = [port for robot, port in self._ports.items() if known.get(robot) != port]
        for port in left:
            if index_of(port.device) == port.index:
                # Its container runs on, but another one's link is the robot's now.
                with suppress(NetworkError):
                    for direction in DIRECTIONS:
                        shaping.clear(port.device, direction)
        # What cannot be removed now must not hide the links that are there; `close` tries again.
        with suppress(NetworkError):
            shaping.forget((port.device, _seat(port)) for port in left)
        self._ports = known
        return known

    def _look(self, robot: str, facts: Mapping[str, Any]) -> _Port | None:
        """A container's link, or None while it has none or where it must not be touched."""
        inside = self._inside(facts["Id"])
        if inside is None:
            return None
        number, outside, mac = inside
        networks = facts["NetworkSettings"]["Networks"].values()
        network = next((n for n in networks if n.get("MacAddress") == mac), None)
        if network is None or not network.get("IPAddress"):
            return None
        with _faults():
            bridge = self._api().inspect_network(network["NetworkID"])
        name = bridge["Options"].get("com.docker.network.bridge.name")
        name = str(name or f"br-{network['NetworkID'][:12]}")
        if (bridge["Labels"] or {}).get(LABEL) != self.swarm:
            self._refused[robot] = (
                f"network {bridge['Name']} of container {facts['Names'][0]} is not the swarm's: "
                f"its label {LABEL} is not {self.swarm!r}"
            )
            return None
        try:
            device = socket.if_indextoname(outside)
        except OSError:
            device = ""
        link = facts_of(device) if device else {}
        if link.get("master") != name or link.get("link_index") != number:
            self._refused[robot] = (
                f"interface {outside} ({device or 'not here'}), where the link of container "
                f"{facts['Names'][0]} should end, is not on bridge {name} of its network "
                f"{bridge['Name']}; the engine must be on this machine, and the controller in the "
                "host's network namespace"
            )
            return None
        return _Port(facts["Id"], device, outside, name, network["IPAddress"])

    def _inside(self, container: str) -> tuple[int, int, str] | None:
        """Index, other end's index and MAC address of a container's `eth0`, read inside; None
        while it is starting or ending."""
        import docker.errors

        files = [f"/sys/class/net/{INSIDE}/{name}" for name in ("ifindex", "iflink", "address")]
        with _faults():
            api = self._api()
            try:
                text = api.exec_start(api.exec_create(container, ["cat", *files])["Id"])
            except docker.errors.APIError as error:
                if error.is_client_error():
                    return None
                raise
        try:
            number, outside, mac = text.decode().split()
            return int(number), int(outside), mac
        except ValueError:
            return None


def _seat(port: _Port) -> Seat:
    return Seat(port.bridge, port.address)


def _by_robot(listed: Collection[Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Running containers by robot; the ego's goes before its robot's, also while it is down: a
    robot's link does not wander."""
    found: dict[str, Mapping[str, Any]] = {}
    for role in ("robot-", "ego-"):
        for facts in listed:
            service = facts["Labels"].get(SERVICE_LABEL, "")
            if service.startswith(role):
                found[service.removeprefix(role)] = facts
    return {robot: facts for robot, facts in found.items() if facts["State"] == "running"}


@contextlib.contextmanager
def _faults() -> Iterator[None]:
    """Turns what Docker's client and its connection raise into NetworkError."""
    import docker.errors

    try:
        yield
    except docker.errors.NotFound as error:
        raise LinkGoneError(f"a container is gone: {error}") from error
    # What the client's connection raises is an OSError.
    except (docker.errors.DockerException, OSError) as error:
        raise NetworkError(f"no Docker engine answers as it should: {error}") from error


DRIVERS = (DockerDriver,)
