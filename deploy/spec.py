"""What a swarm consists of: one validated description that every runtime starts from."""

from __future__ import annotations

import ipaddress
import math
import os
import time
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

import msgspec

from swarm.defaults import (
    CONSOLE_PORT,
    LLM_PORT,
    PERIOD_S,
    POLICY,
    Q_MIN,
    QOD_PORT,
    ROUTER_PORT,
    CommRange,
    Period,
)
from swarm.errors import DeployError, IdentityError, PropertyError
from swarm.keyspace import check_name
from swarm.messages import MIN_RATE_BPS
from swarm.messages.choices import QMin
from swarm.process import PoseError, ProcessSettings, Rings, Seed
from swarm.settings import NAME_RULE, Name, allowed
from swarm.trust.roles import PREFIXES, SITE, Role, role_of
from worlds.kinds import WorldKind
from worlds.registry import swarm_worlds, world_kind

HostPort = Annotated[int, msgspec.Meta(ge=1, le=65532, description="a port")]
MIN_ROBOTS, MAX_ROBOTS = 2, 1000
"""Each has a port of the machine's bridge, and Linux gives a bridge 1,023."""
AREAS_FROM = 65
"""With so many robots egos hear of their surroundings only: 100 that are heard by all cost an ego 6
Mbit/s, wherever they are."""
_ROBOTS = f"{MIN_ROBOTS} to {MAX_ROBOTS} different ids of {NAME_RULE}"

EMBEDDED = "embedded"
_LLM_RULE = "empty, embedded, or http(s)://host[:port][/path] of an OpenAI-compatible server"
_LLM = rf"^({EMBEDDED}|https?://[^\s/?#@]+(/[^\s?#]*)?)?(?!\n)$"
_PROCESS = ProcessSettings()
_SHOWN = 8
"""So many values of a list stand in a message."""


class SwarmSpec(msgspec.Struct, frozen=True, kw_only=True):
    """One swarm as it is to run. Make it with `make_spec`, which checks every field.

    Paths are absolute and belong to the host; a runtime that shows processes other paths (a
    container's volumes) says so in its `services.Place`.
    """

    swarm: Name = _PROCESS.swarm
    runtime: Name = "netns"
    """One of `deploy.runtimes.names()`."""
    robots: Annotated[
        tuple[Name, ...],
        msgspec.Meta(min_length=MIN_ROBOTS, max_length=MAX_ROBOTS, description=_ROBOTS),
    ]
    ego: Name
    egos: tuple[Name, ...] = ()
    """The robots that decide each for itself, `ego` first; empty: `ego` alone does."""
    ego_standby: Name | None = None
    """The robot whose ego stands in for the first one; None: nobody does."""
    world: str = _PROCESS.world
    data: str = ""
    seed: Seed = _PROCESS.world_seed
    rings: Rings = _PROCESS.world_rings
    scenario: str = _PROCESS.world_scenario
    pose_error_m: PoseError = _PROCESS.pose_error_m
    cache: str = ""
    """Directory for scans shared by the swarm's processes; empty keeps none."""
    policy: Name = POLICY
    period_s: Period = PERIOD_S
    q_min: QMin = Q_MIN
    epoch_ns: int = _PROCESS.epoch_ns
    """When frame 0 was captured, nanoseconds since the Unix epoch."""
    prometheus: bool = True
    prometheus_port: HostPort = 9090
    """Where Prometheus answers on the host's 127.0.0.1."""
    ego_metrics_port: HostPort = 9102
    """Where the ego's metrics answer on the host's 127.0.0.1."""
    router_port: HostPort = ROUTER_PORT
    """First of three ports of the router, one a traffic class."""
    qod_port: HostPort = QOD_PORT
    """Where the Quality-on-Demand API answers on the host's 127.0.0.1."""
    controller_metrics_port: HostPort = 9103
    """Where Prometheus scrapes the network controller; in Docker, a port of the host's bridge."""
    areas: bool = False
    """Whether robots say in their keys in which cell of the floor they are, and egos listen to the
    cells around them."""
    listen: str = ""
    """IPv4 address of this machine on which robots and tools elsewhere reach the router; empty:
    only this machine does."""
    world_robots: (
        Annotated[int, msgspec.Meta(ge=MIN_ROBOTS, le=MAX_ROBOTS, description="a number of robots")]
        | None
    ) = None
    """For how many robots a simulated world has room, as others may join those that `up` starts;
    None: for no others."""
    comm_range_m: CommRange | None = None
    """How far from the ego a robot may take part; None leaves it to the ego and its world."""
    link_bps: Annotated[int, msgspec.Meta(ge=MIN_RATE_BPS, description="bit/s")] | None = None
    """Rate of the cell towards the ego; None leaves it unshaped."""
    cell: Literal["own", "shared"] = "own"
    """Whether each ego has a cell of its own, or all egos share one of that rate."""
    llm: Annotated[str, msgspec.Meta(pattern=_LLM, description=_LLM_RULE)] = ""
    """Where language models answer: `embedded`, or the URL of a server; empty runs no gateway."""
    llm_model: Annotated[str, msgspec.Meta(max_length=200)] = ""
    """Which model; empty takes the embedded one's or the server's first."""
    llm_port: HostPort = LLM_PORT
    """Where the LLM gateway's HTTP endpoint answers on the host's 127.0.0.1."""
    gateway_metrics_port: HostPort = 9105
    """Where Prometheus scrapes the LLM gateway; in Docker, a port of the host's bridge."""
    grafana: bool = False
    """Whether Grafana shows what Prometheus has; in Docker only."""
    grafana_port: HostPort = 3000
    """Where Grafana answers on the host's 127.0.0.1."""
    console: bool = False
    """Whether the operator's console runs."""
    console_port: HostPort = CONSOLE_PORT
    """Where it answers on the host's 127.0.0.1."""
    console_metrics_port: HostPort = 9107
    """Where Prometheus scrapes the console; in Docker, a port of the host's bridge."""
    secure: bool = False
    """Whether every process shows a certificate, and may do only its part (docs/security.md); in
    Docker they do unless this says no."""
    metrics_tls: bool = False
    """Whether processes serve their metrics over TLS; in a secure swarm only."""
    run_dir: str
    """Sockets and state of the running swarm; removed by `down`."""
    var_dir: str
    """Journals, logs and Prometheus' data; kept by `down`."""

    @property
    def all_egos(self) -> tuple[str, ...]:
        """The robots that decide, the first ego first; a standby is not one of them."""
        return self.egos or (self.ego,)

    def differences(self, other: SwarmSpec) -> tuple[str, ...]:
        """The names of the properties in which two specifications differ, but for when they were
        started."""
        return tuple(
            name
            for name in PROPERTIES
            if name != "epoch_ns" and getattr(self, name) != getattr(other, name)
        )

    def room(self) -> int:
        """For how many robots a simulated world has room."""
        return self.world_robots or len(self.robots)

    def llm_server(self) -> tuple[str, int] | None:
        """Host and port of the model server; None without one."""
        if self.llm in ("", EMBEDDED):
            return None
        parts = urlsplit(self.llm)
        return parts.hostname or "", parts.port or (443 if parts.scheme == "https" else 80)

    def same_as(self, other: SwarmSpec) -> bool:
        """Whether both describe the same swarm, started at whatever time."""
        return not self.differences(other)


PROPERTIES = {field.name: field for field in msgspec.structs.fields(SwarmSpec)}
PORT_FIELDS = tuple(name for name in PROPERTIES if name.endswith("_port"))


def factory_robots(count: int) -> tuple[str, ...]:
    """The robot ids of a simulated factory: R1 to Rn."""
    return tuple(f"R{number}" for number in range(1, count + 1))


def make_spec(**values: Any) -> SwarmSpec:
    """A checked specification.

    `ego` defaults to the first of `egos`, or else of the robots, `areas` to whether there may be
    AREAS_FROM of them, `epoch_ns` to now, `run_dir` to `run_dir_of`, and `var_dir` to `var_dir_of`;
    `comm_range_m` to what is usual with the world's detector, or it is left to the ego, where only
    the data says which that is.

    Raises DeployError that names the field, its value and what is allowed.
    """
    for name, value in values.items():
        if name not in PROPERTIES:
            raise DeployError(f"{name} is not a property of a swarm; allowed: {sorted(PROPERTIES)}")
        if isinstance(value, float) and not math.isfinite(value):
            raise _invalid(name, value)
        try:
            msgspec.convert(value, PROPERTIES[name].type)
        except msgspec.ValidationError as error:
            raise _invalid(name, value) from error
    robots = tuple(values.get("robots", ()))
    if len(set(robots)) != len(robots) or not robots:
        raise _invalid("robots", robots)
    if "infra" in robots:
        raise DeployError("robot id 'infra' is taken by the router's and Prometheus' host")
    name = values.get("world", _PROCESS.world)
    if name not in swarm_worlds():
        raise _invalid("world", name, f"one of {', '.join(swarm_worlds())}")
    world = world_kind(name)
    swarm = values.get("swarm", _PROCESS.swarm)
    egos = tuple(values.get("egos", ()))
    values.setdefault("ego", (egos or robots)[0])
    most = max(len(robots), values.get("world_robots") or 0)
    values.setdefault("areas", most >= AREAS_FROM)
    near = _is_near(values.get("listen", ""))
    # Containers hear of each other over a network that others may share.
    values.setdefault("secure", values.get("runtime") == "docker" or not near)
    if not (near or values["secure"]):
        raise _invalid(
            "listen",
            values["listen"],
            "an address of the loopback (127.0.0.1) in a plain swarm, as whoever reaches its "
            "router is believed; leave out --no-secure (SECURE=0) for another one",
        )
    _check_room(world, robots, values.get("world_robots"))
    if values.get("comm_range_m") is None:
        values["comm_range_m"] = world.comm_range_m
    values.setdefault("epoch_ns", time.time_ns())
    values.setdefault("run_dir", str(run_dir_of(swarm)))
    values.setdefault("var_dir", str(var_dir_of(swarm)))
    if values["ego"] not in robots:
        raise DeployError(f"ego {values['ego']!r} is not one of the robots {', '.join(robots)}")
    if egos:
        values["egos"] = _egos(egos, values["ego"], robots)
    standby = values.get("ego_standby")
    deciding = values.get("egos") or (values["ego"],)
    if standby is not None and (standby not in robots or standby in deciding):
        others = ", ".join(robot for robot in robots if robot not in deciding)
        raise _invalid("ego_standby", standby, f"a robot that is not the ego: {others}")
    if not _has_data(world, values.get("data", "")):
        raise _invalid("data", values.get("data", ""), f"{world.needs} (needed by {world.name})")
    if values["secure"]:
        _check_names(robots)
    spec: SwarmSpec = msgspec.convert(values, SwarmSpec)
    try:
        server = spec.llm_server()
    except ValueError as error:
        raise _invalid("llm", spec.llm) from error
    if server is not None and not server[0]:
        raise _invalid("llm", spec.llm)
    if spec.grafana and spec.runtime != "docker":
        raise DeployError(
            f"--grafana needs the Docker runtime, and this swarm would run in {spec.runtime}; "
            "docs/dashboards.md says how a Grafana of your own shows the same dashboards"
        )
    if spec.metrics_tls and not spec.secure:
        raise DeployError(
            "--metrics-tls serves metrics with the processes' certificates, and a plain swarm has "
            "none: start it with --secure"
        )
    if spec.grafana and not spec.prometheus:
        raise DeployError("--grafana shows what Prometheus has: leave out --no-prometheus")
    return spec


def _egos(egos: tuple[str, ...], first: str, robots: tuple[str, ...]) -> tuple[str, ...]:
    """Those that decide, the first one first; none where it is alone. Raises PropertyError."""
    if len(set(egos)) != len(egos) or not set(egos) <= set(robots) or first not in egos:
        rule = f"different ones of the robots {', '.join(robots)}, with the ego {first}"
        raise _invalid("egos", egos, rule)
    return (first, *(ego for ego in egos if ego != first)) if len(egos) > 1 else ()


def _is_near(listen: str) -> bool:
    """Whether only this machine reaches an address. Raises DeployError for no IPv4 address."""
    if not listen:
        return True
    rule = "an IPv4 address of this machine, like 192.168.1.10"
    try:
        address = ipaddress.IPv4Address(listen)
    except ValueError as error:
        raise _invalid("listen", listen, rule) from error
    # A certificate is for an address, and others need one that they can type.
    if address.is_unspecified or address.is_multicast:
        raise _invalid("listen", listen, rule)
    return address.is_loopback


def _check_room(world: WorldKind, robots: tuple[str, ...], room: int | None) -> None:
    """Raises DeployError for a world that cannot have room for others, or has too little."""
    if room is None:
        return
    if not world.numbered:
        raise _invalid("world_robots", room, f"left out: world {world.name} has the robots it has")
    if room < len(robots):
        raise _invalid("world_robots", room, f"{len(robots)} at least, as that many are started")


def _check_names(robots: tuple[str, ...]) -> None:
    """Raises DeployError for a robot whose certificate could not be its own."""
    for robot in robots:
        try:
            own = role_of(robot) == Role("robot", robot)
            role_of(Role("ego", robot).common_name)
        except IdentityError as error:
            raise DeployError(
                f"robot id {robot!r} is too long for a secure swarm: {error}"
            ) from error
        if not own:
            raise DeployError(
                f"robot id {robot!r} is the name of another role in a secure swarm; choose one "
                f"that is none of {', '.join(SITE)} and begins with none of "
                f"{', '.join(PREFIXES.values())}"
            )


def _has_data(world: WorldKind, data: str) -> bool:
    """Whether a recorded world's data is there; simulated ones need none."""
    if world.data == "file":
        return bool(data) and Path(data).is_file()
    return not world.data or (bool(data) and Path(data).is_dir())


def run_base() -> Path:
    """The directory that holds the run directories of this user's swarms: `$COADAPT_RUN_DIR`, or
    `/tmp/coadapt-<uid>` (short, as the paths of Unix sockets have to be)."""
    return Path(os.environ.get("COADAPT_RUN_DIR") or f"/tmp/coadapt-{os.getuid()}").absolute()


def run_dir_of(swarm: str) -> Path:
    """The run directory of one of this user's swarms.

    Raises KeyspaceError for a name that may lead elsewhere.
    """
    return run_base() / check_name("swarm name", swarm)


def var_dir_of(swarm: str) -> Path:
    """Where a swarm that is started in the current directory keeps what outlives it."""
    return Path.cwd() / "var" / swarm


def _invalid(name: str, value: object, rule: str = "") -> PropertyError:
    return PropertyError(name, value, _shown(value), rule or allowed(PROPERTIES[name].type))


def _shown(value: object) -> str:
    """A value as it stands in a message: of a long list, its length and its ends."""
    if isinstance(value, tuple) and len(value) > _SHOWN:
        return f"{len(value)} values from {value[0]!r} to {value[-1]!r}"
    return repr(value)
