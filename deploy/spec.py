"""What a swarm consists of: one validated description that every runtime starts from."""

from __future__ import annotations

import math
import os
import time
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

import msgspec

from swarm.errors import DeployError
from swarm.keyspace import check_name
from swarm.messages import MIN_RATE_BPS
from swarm.settings import Name
from worlds.kinds import WorldKind
from worlds.registry import swarm_worlds, world_kind

RuntimeName = Literal["docker", "netns"]
HostPort = Annotated[int, msgspec.Meta(ge=1, le=65532)]
MIN_ROBOTS, MAX_ROBOTS = 2, 100

EMBEDDED = "embedded"
_LLM = rf"^({EMBEDDED}|https?://[^\s/?#@]+(/[^\s?#]*)?)?(?!\n)$"
_NAME_RULE = "1 to 32 letters, digits, '_' or '-'"
_PORT_RULE = "a port from 1 to 65532"
_ALLOWED = {
    "swarm": _NAME_RULE,
    "runtime": "docker or netns",
    "robots": f"{MIN_ROBOTS} to {MAX_ROBOTS} different ids of {_NAME_RULE}",
    "ego": "one of the robots",
    "seed": "a whole number >= 0",
    "rings": "16, 32 or 64",
    "policy": "the name of a policy: lower-case letters, digits and '-'",
    "period_s": "seconds > 0 and <= 60",
    "q_min": "a number from 0 to 1",
    "prometheus_port": _PORT_RULE,
    "ego_metrics_port": _PORT_RULE,
    "router_port": _PORT_RULE,
    "qod_port": _PORT_RULE,
    "controller_metrics_port": _PORT_RULE,
    "comm_range_m": "metres > 0 and <= 10000, or unset",
    "link_bps": f"bit/s >= {MIN_RATE_BPS}, or unset",
    "llm": "empty, embedded, or http(s)://host[:port][/path] of an OpenAI-compatible server",
    "llm_model": "the name of a model, at most 200 characters",
    "llm_port": _PORT_RULE,
    "gateway_metrics_port": _PORT_RULE,
    "grafana_port": _PORT_RULE,
    "console_port": _PORT_RULE,
    "console_metrics_port": _PORT_RULE,
}


class SwarmSpec(msgspec.Struct, frozen=True, kw_only=True):
    """One swarm as it is to run. Make it with `make_spec`, which checks every field.

    Paths are absolute and belong to the host; a runtime that shows processes other paths (a
    container's volumes) says so in its `services.Place`.
    """

    swarm: Name = "local"
    runtime: RuntimeName = "netns"
    robots: Annotated[tuple[Name, ...], msgspec.Meta(min_length=MIN_ROBOTS, max_length=MAX_ROBOTS)]
    ego: Name
    world: str = "factory"
    data: str = ""
    seed: Annotated[int, msgspec.Meta(ge=0)] = 1
    rings: Literal[16, 32, 64] = 32
    scenario: str = "floor"
    cache: str = ""
    """Directory for scans shared by the swarm's processes; empty keeps none."""
    policy: Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9-]{1,32}$")] = "coverage"
    period_s: Annotated[float, msgspec.Meta(gt=0, le=60)] = 1.0
    q_min: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.7
    epoch_ns: int = 0
    """When frame 0 was captured, nanoseconds since the Unix epoch."""
    prometheus: bool = True
    prometheus_port: HostPort = 9090
    """Where Prometheus answers on the host's 127.0.0.1."""
    ego_metrics_port: HostPort = 9102
    """Where the ego's metrics answer on the host's 127.0.0.1."""
    router_port: HostPort = 7447
    """First of three ports of the router, one a traffic class."""
    qod_port: HostPort = 9104
    """Where the Quality-on-Demand API answers on the host's 127.0.0.1."""
    controller_metrics_port: HostPort = 9103
    """Where Prometheus scrapes the network controller; in Docker, a port of the host's bridge."""
    comm_range_m: Annotated[float, msgspec.Meta(gt=0, le=10_000)] | None = None
    """How far from the ego a robot may take part; None leaves it to the ego's settings."""
    link_bps: Annotated[int, msgspec.Meta(ge=MIN_RATE_BPS)] | None = None
    """Rate of the cell towards the ego; None leaves it unshaped."""
    llm: Annotated[str, msgspec.Meta(pattern=_LLM)] = ""
    """Where language models answer: `embedded`, or the URL of a server; empty runs no gateway."""
    llm_model: Annotated[str, msgspec.Meta(max_length=200)] = ""
    """Which model; empty takes the embedded one's or the server's first."""
    llm_port: HostPort = 9106
    """Where the LLM gateway's HTTP endpoint answers on the host's 127.0.0.1."""
    gateway_metrics_port: HostPort = 9105
    """Where Prometheus scrapes the LLM gateway; in Docker, a port of the host's bridge."""
    grafana: bool = False
    """Whether Grafana shows what Prometheus has; in Docker only."""
    grafana_port: HostPort = 3000
    """Where Grafana answers on the host's 127.0.0.1."""
    console: bool = False
    """Whether the operator's console runs."""
    console_port: HostPort = 8080
    """Where it answers on the host's 127.0.0.1."""
    console_metrics_port: HostPort = 9107
    """Where Prometheus scrapes the console; in Docker, a port of the host's bridge."""
    run_dir: str
    """Sockets and state of the running swarm; removed by `down`."""
    var_dir: str
    """Journals, logs and Prometheus' data; kept by `down`."""

    def differences(self, other: SwarmSpec) -> tuple[str, ...]:
        """The names of the properties in which two specifications differ, but for when they were
        started."""
        names = (field.name for field in msgspec.structs.fields(SwarmSpec))
        return tuple(
            name
            for name in names
            if name != "epoch_ns" and getattr(self, name) != getattr(other, name)
        )

    def llm_server(self) -> tuple[str, int] | None:
        """Host and port of the model server; None without one."""
        if self.llm in ("", EMBEDDED):
            return None
        parts = urlsplit(self.llm)
        return parts.hostname or "", parts.port or (443 if parts.scheme == "https" else 80)

    def same_as(self, other: SwarmSpec) -> bool:
        """Whether both describe the same swarm, started at whatever time."""
        return not self.differences(other)


def factory_robots(count: int) -> tuple[str, ...]:
    """The robot ids of a simulated factory: R1 to Rn."""
    return tuple(f"R{number}" for number in range(1, count + 1))


def make_spec(**values: Any) -> SwarmSpec:
    """A checked specification.

    `ego` defaults to the first robot, `epoch_ns` to now, `comm_range_m` to what the world's
    recordings were evaluated with, `run_dir` to `run_dir_of`, and `var_dir` to `var/<swarm>` in
    the current directory.

    Raises DeployError that names the field, its value and what is allowed.
    """
    fields = {field.name: field for field in msgspec.structs.fields(SwarmSpec)}
    for name, value in values.items():
        if name not in fields:
            raise DeployError(f"{name} is not a property of a swarm; allowed: {sorted(fields)}")
        if isinstance(value, float) and not math.isfinite(value):
            raise _invalid(name, value)
        try:
            msgspec.convert(value, fields[name].type)
        except msgspec.ValidationError as error:
            raise _invalid(name, value) from error
    robots = tuple(values.get("robots", ()))
    if len(set(robots)) != len(robots) or not robots:
        raise _invalid("robots", robots)
    if "infra" in robots:
        raise DeployError("robot id 'infra' is taken by the router's and Prometheus' host")
    name = values.get("world", "factory")
    if name not in swarm_worlds():
        raise _invalid("world", name, f"one of {', '.join(swarm_worlds())}")
    world = world_kind(name)
    swarm = values.get("swarm", "local")
    values.setdefault("ego", robots[0])
    if values.get("comm_range_m") is None:
        values["comm_range_m"] = world.comm_range_m
    values.setdefault("epoch_ns", time.time_ns())
    values.setdefault("run_dir", str(run_dir_of(swarm)))
    values.setdefault("var_dir", str(Path.cwd() / "var" / swarm))
    if values["ego"] not in robots:
        raise DeployError(f"ego {values['ego']!r} is not one of the robots {', '.join(robots)}")
    if not _has_data(world, values.get("data", "")):
        raise _invalid("data", values.get("data", ""), f"{world.needs} (needed by {world.name})")
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
    if spec.grafana and not spec.prometheus:
        raise DeployError("--grafana shows what Prometheus has: leave out --no-prometheus")
    return spec


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


def _invalid(name: str, value: object, allowed: str = "") -> DeployError:
    allowed = allowed or _ALLOWED.get(name, "a text without limits")
    return DeployError(f"{name} = {value!r} is not valid; it must be {allowed}")
