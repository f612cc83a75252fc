"""The roster's processes as containers on machines of a cluster, before an engine is named.

Docker Swarm (`deploy.cluster.stack`) and Kubernetes (`deploy.cluster.kubernetes`) write the same
containers down, each in its own words.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from deploy import environments, paths, roster, scraping
from deploy.docker import compose
from deploy.paths import identity_path
from deploy.ports import LOCALHOST
from deploy.roster import Place, Service
from deploy.services import services
from deploy.spec import EMBEDDED, SwarmSpec
from swarm.errors import DeployError
from swarm.trust.identity import CA, CERTIFICATE, KEY, Identity
from swarm.trust.members import MEMBERS
from swarm.trust.roles import Role, role_of

Network = Literal["host", "overlay"]
NETWORK: Network = "host"
USER = 10001
"""Who the processes are in a cluster's containers, where no user of the host is meant; the image's
folders below `PLACE.var_dir` are that user's (Dockerfile)."""
TMP_BYTES = 64 << 20
PIDS = 512
ENDS_S = 5
"""A process that has not ended so long after SIGTERM is killed, as in Docker."""
HEALTH_PERIOD_S, HEALTH_TIMEOUT_S, HEALTH_RETRIES, HEALTH_START_S = 10, 5, 3, 60
"""A process whose metrics do not answer three times is started anew; it has a minute to begin."""
IMAGE = "COADAPT_IMAGE"
"""The setting that names the image, as `--image` does."""
IMAGE_RULE = "[HOST[:PORT]/]NAME[:TAG][@sha256:DIGEST]"
_IMAGE = re.compile(
    r"([A-Za-z0-9.-]+(:\d{1,5})?/)?[a-z0-9]+([._-]+[a-z0-9]+)*(/[a-z0-9]+([._-]+[a-z0-9]+)*)*"
    r"(:\w[\w.-]{0,127})?(@sha256:[0-9a-f]{64})?"
)
_NOT_FOR_PROCESSES = compose.NOT_FOR_PROCESSES | {IMAGE, "COADAPT_HOST", "COADAPT_METRICS_TLS"}
_UNITS = {"m": 1 << 20, "g": 1 << 30}


@dataclass(frozen=True, slots=True)
class Cluster:
    """What an operator says of the machines. Make it with `make_cluster`."""

    image: str
    """The swarm's image by its name in a registry that all machines reach."""
    router: str
    """Name or address at which all machines reach the router."""
    network: Network = NETWORK
    llm_image: str = ""
    """The image of the gateway where it runs the embedded model; empty: `image`."""
    interface: str = ""
    """The interface of each robot's node that a network controller there shapes; empty: no link is
    shaped, and C(t) is measured only."""
    default_route: bool = False
    """Whether it may be the one of the default route."""
    hosts: Mapping[str, str] = field(default_factory=dict)
    """The robots whose nodes have routers of their own, and the address of each node."""


@dataclass(frozen=True, slots=True)
class Container:
    """One process in a container."""

    service: Service
    image: str
    env: Mapping[str, str]
    memory: int
    """Bytes that it may take."""
    common_name: str
    """What its certificate says; empty for one that takes no part in the swarm's network."""
    files: Mapping[str, Path]
    """Secrets: where the container finds each, and the file of this machine that holds it."""
    folders: tuple[str, ...] = ()
    """What it writes and what should outlive it, or what it shares with others of its node: folders
    of `PLACE.var_dir`."""
    capabilities: tuple[str, ...] = ()
    """Those of `USER` are none; a container with some is root's."""
    data: str = ""
    """Recorded data: a folder that is the same on every machine, read only, at `compose.DATA`."""
    tls: bool = False
    """Whether it serves its metrics over TLS."""
    ports: tuple[int, ...] = field(default=())
    """Where others of the swarm reach it, beside its metrics."""

    @property
    def robot(self) -> str:
        """The robot on whose machine it runs; empty: on the site's."""
        return self.service.robot

    @property
    def user(self) -> int:
        """Who its process is."""
        return 0 if self.capabilities else USER


def make_cluster(
    image: str,
    router: str,
    network: Network = NETWORK,
    llm_image: str = "",
    interface: str = "",
    *,
    default_route: bool = False,
) -> Cluster:
    """A checked description. Raises DeployError that names what is not valid."""
    for option, name in (("--image", image), ("--llm-image", llm_image)):
        if name and not _IMAGE.fullmatch(name):
            raise DeployError(f"{option} {name!r} is not valid; it must be {IMAGE_RULE}")
    if not image:
        raise DeployError(
            f"the cluster's machines pull the swarm's image: name it by --image or {IMAGE}, "
            f"{IMAGE_RULE}"
        )
    if not re.fullmatch(r"[A-Za-z0-9.:_-]+", router):
        raise DeployError(
            f"--router {router!r} is not valid; it must be a host's name or IP address"
        )
    if interface and not re.fullmatch(r"[^\s/]{1,15}", interface):
        raise DeployError(f"--interface {interface!r} is not the name of an interface, like eth1")
    if interface and network != "host":
        raise DeployError(
            f"--interface {interface} needs --network host: what the nodes' own interfaces carry "
            "of another network cannot be told apart by robots"
        )
    return Cluster(image, router, network, llm_image, interface, default_route)


def place_of(spec: SwarmSpec, cluster: Cluster) -> Place:
    """Where the processes find things inside their containers."""
    return Place(
        listen_host=compose.PLACE.listen_host,
        router_host=cluster.router,
        var_dir=compose.PLACE.var_dir,
        prometheus_config=compose.PLACE.prometheus_config,
        data=compose.DATA if spec.data else "",
        prometheus_host_port=roster.PROMETHEUS_PORT,
        targets=compose.TARGETS if cluster.network == "host" else "",
    )


def containers(spec: SwarmSpec, cluster: Cluster) -> tuple[Container, ...]:
    """The containers of a swarm, in the order of the roster.

    Who renews certificates is left out, as the keystore stays with the operator. Each robot's node
    has a network controller of its own, where an interface is named. Raises DeployError for a
    secret that would stand in what is written.
    """
    if spec.llm == EMBEDDED and not cluster.llm_image:
        raise DeployError(
            "--llm embedded needs --llm-image, an image with the model (deploy/docker/llm_image.py)"
        )
    place = place_of(spec, cluster)
    members = services(spec, place)
    (router,) = (member for member in members if member.role == "router")
    hosts = (cluster.router, *cluster.hosts.values())
    routers = [
        # Of two routers one names the other: each names those before it.
        _own_router(spec, place, router, robot, hosts[:number])
        for number, robot in enumerate(cluster.hosts, 1)
    ]
    found = [
        _container(spec, cluster, _at_own_router(spec, cluster, place, member))
        for member in (router, *routers, *(one for one in members if one is not router))
        if member.role not in ("authority", "controller", "grafana")
    ]
    if cluster.interface:
        (site,) = (member for member in members if member.role == "controller")
        found += [_controller(spec, cluster, place, site, robot) for robot in spec.robots]
    return tuple(found)


def roles(spec: SwarmSpec, cluster: Cluster) -> list[str]:
    """The common names of those who need a certificate there."""
    return [one.common_name for one in containers(spec, cluster) if one.common_name]


def router_addresses(cluster: Cluster) -> dict[str, tuple[str, ...]]:
    """The common names of the routers that robots' nodes have, and where others reach each."""
    return {Role("router", robot).common_name: (host,) for robot, host in cluster.hosts.items()}


def identity_files(var_dir: str, common_name: str) -> dict[str, Path]:
    """A role's identity: the place in a container of each file, and where it lies here."""
    identity = Identity(Path(identity_path(var_dir, common_name)))
    there = identity_path(compose.PLACE.var_dir, common_name)
    names = (CA, CERTIFICATE, KEY, *((MEMBERS,) if role_of(common_name).kind == "router" else ()))
    return {f"{there}/{name}": identity.folder / name for name in names}


def _container(spec: SwarmSpec, cluster: Cluster, service: Service) -> Container:
    if service.role == "prometheus" and cluster.network == "host":
        # It asks nobody who it is: for whoever is on its node.
        local = (word.replace("=0.0.0.0:", f"={LOCALHOST}:") for word in service.argv)
        service = replace(service, argv=tuple(local))
    own, files = _settings(service)
    if spec.secure and service.common_name:
        files |= identity_files(spec.var_dir, service.common_name)
    if spec.secure and service.role == "prometheus":
        place, here = map(paths.authority_path, (compose.PLACE.var_dir, spec.var_dir))
        files[place] = Path(here)
    limit = compose.MEMORY[service.role]
    ports = range(spec.router_port, spec.router_port + 3) if service.role == "router" else ()
    gateway = service.role == "gateway" and cluster.llm_image
    return Container(
        service=service,
        image=cluster.llm_image if gateway else cluster.image,
        env={**own, **service.env, "HOME": "/tmp", **compose.CACHES.get(service.role, {})},
        memory=int(limit[:-1]) * _UNITS[limit[-1]],
        common_name=service.common_name,
        files=files,
        folders=_folders(spec, cluster, service),
        data=spec.data if service.role in ("ego", "robot") else "",
        tls=spec.metrics_tls and service.role in scraping.OVER_TLS,
        ports=tuple(ports),
    )


def _own_router(
    spec: SwarmSpec, place: Place, site: Service, robot: str, peers: Sequence[str]
) -> Service:
    """The router of a robot's node; `site`: that of the site; `peers`: hosts of routers that it
    names."""
    of_site, own = (
        identity_path(place.var_dir, Role("router", name).common_name) for name in ("", robot)
    )
    # Only the site's tells Prometheus who joined, wherever: it is on Prometheus' node.
    unlike = ("--targets", place.targets)
    argv = (
        *(own if word == of_site else word for word in site.argv if word not in unlike),
        *(word for peer in peers for word in ("--peer", f"tls/{peer}:{spec.router_port}")),
    )
    return replace(site, name=f"router-{robot}", host=robot, robot=robot, argv=argv)


def _at_own_router(spec: SwarmSpec, cluster: Cluster, place: Place, service: Service) -> Service:
    """A process of a node that has a router of its own goes to that one, at the node's address: an
    ego knows its own connections by their addresses."""
    if service.robot not in cluster.hosts or "COADAPT_ROUTER" not in service.env:
        return service
    identity = identity_path(place.var_dir, service.common_name)
    address = environments.router_address(spec, cluster.hosts[service.robot], identity)
    return replace(service, env=service.env | {"COADAPT_ROUTER": address})


def _controller(
    spec: SwarmSpec, cluster: Cluster, place: Place, site: Service, robot: str
) -> Container:
    """The network controller of a robot's node; `site`: the only one of a swarm on one machine."""
    name = Role("controller", robot).common_name
    identity = identity_path(place.var_dir, name)
    router = cluster.hosts.get(robot, cluster.router)
    shaped = {"COADAPT_LINK_BPS", "COADAPT_LINK_RATES_BPS", "COADAPT_LINK_INTERVAL_S"}
    # Only the ego's node has the ego's link.
    env = {k: v for k, v in site.env.items() if robot == spec.ego or k not in shaped} | {
        "COADAPT_ROUTER": environments.router_address(spec, router, identity),
        "COADAPT_CONTROLLER": robot,
        "COADAPT_DRIVER": "interface",
        "COADAPT_INTERFACE": cluster.interface,
        "COADAPT_INTERFACE_ROBOTS": robot,
        "COADAPT_INTERFACE_CONFIRMED": cluster.interface if cluster.default_route else "",
        "COADAPT_INTERFACE_STATE": f"{place.var_dir}/{paths.NET}/interface.json",
    }
    service = replace(site, name=f"controller-{robot}", host=robot, robot=robot, env=env)
    made = _container(spec, cluster, service)
    return replace(
        made,
        common_name=name,
        files=identity_files(spec.var_dir, name)
        | {place: file for place, file in made.files.items() if place.startswith("/run/")},
        capabilities=tuple(compose.CONTROLLER["cap_add"]),
    )


def _folders(spec: SwarmSpec, cluster: Cluster, service: Service) -> tuple[str, ...]:
    own = compose.FOLDERS.get(service.role, "")
    told = spec.prometheus and cluster.network == "host" and not service.robot
    shared = paths.TARGETS if told and service.role in ("router", "prometheus") else ""
    return tuple(filter(None, (own, shared)))


def _settings(service: Service) -> tuple[dict[str, str], dict[str, Path]]:
    """Settings from the caller's environment that there is no option for, and the files that some
    of them name. Raises DeployError for a secret's value: what is written here is kept and sent."""
    if service.role not in ("robot", "ego", "controller", "gateway", "console"):
        return {}, {}
    own = environments.inherited(service.role, os.environ)
    found = {k: v for k, v in own.items() if k.startswith("COADAPT_")}
    found = {k: v for k, v in found.items() if k not in _NOT_FOR_PROCESSES}
    files: dict[str, Path] = {}
    for secret in environments.KEPT:
        if found.get(secret):
            raise DeployError(
                f"{secret} is set, and its value would stand in what is written; name a file that "
                f"holds it by {secret}_FILE"
            )
        if file := found.get(f"{secret}_FILE"):
            found[f"{secret}_FILE"] = compose.SECRETS[secret]
            files[compose.SECRETS[secret]] = Path(file).absolute()
    return found, files
