"""The processes of a swarm, as every runtime starts them, and what Prometheus scrapes of them."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import yaml

from deploy.spec import EMBEDDED, SwarmSpec
from swarm.trust.identity import CA, ISSUED
from swarm.trust.roles import Role as TrustRole
from swarm.trust.serving import SERVER_NAME
from worlds.factory.scenarios import link_steps_bps

Role = Literal[
    "router", "controller", "gateway", "robot", "ego", "console", "authority", "prometheus",
    "grafana",
]  # fmt: skip
INFRA = "infra"
ROUTER_METRICS_PORT = 9100
ROBOT_METRICS_PORT = 9101
EGO_METRICS_PORT = 9102
PROMETHEUS_PORT = 9090
SCRAPE_S = 2
EVALUATE_S = 5
"""How often Prometheus looks whether an alert fires."""
OVER_TLS = ("router", "controller", "gateway", "robot", "ego", "console")
"""Roles that serve metrics over TLS where a swarm's do."""
REFRESH_S = 10
"""How often it reads the file of targets again where it is not told that it has changed."""
RETENTION = "512MB"
EGO_THREADS, MANY_EGOS_THREADS = "2", "1"
"""An ego decodes for everybody within a cycle: more than one core helps it, unless others want it,
too."""
JOURNAL = "journal"
NET = "net"
"""The controller's part of `var_dir`."""
LLM = "llm"
"""The gateway's."""
RECORDINGS = "recordings"
"""Where `coadapt record` writes; the console shows it."""
KEYSTORE = "keystore"
"""A secure swarm's certificates (`deploy.trust.keystore`)."""
TARGETS = "targets"
"""Where the router tells Prometheus of processes that joined: a folder, for a file that is replaced
is not seen through a mount of its own."""
FOLDERS = (JOURNAL, NET, LLM, RECORDINGS, TARGETS, "prometheus")
AUTHORITY_METRICS_PORT = 9108
SECRETS: Mapping[str, Role] = {
    "COADAPT_QOD_": "controller",
    "COADAPT_LLM_API_KEY": "gateway",
    "COADAPT_LLM_HTTP_": "gateway",
    "COADAPT_CONSOLE_": "console",
}
"""Settings, by how their names begin, that only one role may know."""
API_KEY, API_KEY_FILE = "COADAPT_LLM_API_KEY", "COADAPT_LLM_API_KEY_FILE"
KEPT = (API_KEY, "COADAPT_LLM_HTTP_TOKEN", "COADAPT_QOD_TOKEN", "COADAPT_CONSOLE_TOKEN")
"""Keys and tokens: no file that the project writes holds one. The same name with `_FILE` behind it
names a file of the operator's own that does."""


@dataclass(frozen=True, slots=True)
class Place:
    """What differs between runtimes: programs, addresses and paths as the processes see them."""

    listen_host: str
    """Address that the router listens on."""
    router_host: str
    """Address by which the other processes reach the router."""
    var_dir: str
    """Holds `journal/` (the ego's), `net/` (the controller's), `llm/` (the gateway's) and
    `prometheus/` (its data); the runtime makes them."""
    prometheus_config: str
    """Path of the file with `prometheus_config`."""
    driver: Literal["netns", "docker"] = "netns"
    """How the network controller finds links."""
    qod_socket: str = ""
    """Socket of the Quality-on-Demand API; empty: it answers on the host's 127.0.0.1 itself."""
    site_router_host: str = ""
    """Address by which controller and gateway reach the router, where that is another one."""
    site_metrics_host: str = "0.0.0.0"
    """Address that the metrics of controller, gateway and console listen on."""
    targets: str = ""
    """File in which the router tells Prometheus of processes that joined; empty for none."""
    unix_socket: str = ""
    """Socket that the router listens on as well, for tools on the host; empty for none."""
    data: str = ""
    """The recorded world's directory; empty for a simulated one."""
    cache: str = ""
    prometheus_host_port: int = PROMETHEUS_PORT
    """Port at which the console reaches Prometheus on its own loopback."""
    python: str = "python3"
    prometheus: str = "prometheus"


@dataclass(frozen=True, slots=True)
class Service:
    """One process. Services with the same host share a network namespace and an address."""

    name: str
    role: Role
    host: str
    """`infra` or a robot id."""
    argv: tuple[str, ...]
    """Empty: what the service's own image runs."""
    env: dict[str, str] = field(default_factory=dict)
    metrics_port: int | None = None
    """Where it serves /metrics on its host's address."""
    robot: str = ""
    restart: Literal["always", "no"] = "always"

    @property
    def common_name(self) -> str:
        """What its certificate says; empty for one that takes no part in the swarm's network."""
        match self.role:
            case "robot":
                return self.robot
            case "ego":
                return TrustRole("ego", self.robot).common_name
            case "router" | "authority" | "controller" | "gateway" | "console":
                return self.role
        return ""


def services(spec: SwarmSpec, place: Place) -> tuple[Service, ...]:
    """Router, controller, gateway, robots, ego, console, Prometheus and Grafana, in the order in
    which to start them."""
    router = Service(
        name="router",
        role="router",
        host=INFRA,
        argv=(
            *(place.python, "-m", "swarm.router"),
            *("--host", place.listen_host, "--port", str(spec.router_port)),
            *("--swarm", spec.swarm),
            *("--metrics-port", str(ROUTER_METRICS_PORT)),
            *(("--unix-socket", place.unix_socket) if place.unix_socket else ()),
            *(("--metrics-tls",) if spec.metrics_tls else ()),
            *(("--targets", place.targets) if place.targets and spec.prometheus else ()),
            *(("--identity", identity_path(place.var_dir, "router")) if spec.secure else ()),
        ),
        metrics_port=ROUTER_METRICS_PORT,
    )
    controller = Service(
        name="controller",
        role="controller",
        host=INFRA,
        argv=(place.python, "-m", "network_controller"),
        env=_controller_environment(spec, place),
        metrics_port=spec.controller_metrics_port,
    )
    gateway = Service(
        name="gateway",
        role="gateway",
        host=INFRA,
        argv=(place.python, "-m", "llm_gateway"),
        env=_gateway_environment(spec, place),
        metrics_port=spec.gateway_metrics_port,
    )
    robots = [
        Service(
            name=f"robot-{robot}",
            role="robot",
            host=robot,
            argv=(place.python, "-m", "robot_agent"),
            env=_environment(spec, place, robot, ROBOT_METRICS_PORT)
            | {"COADAPT_ROBOTS": robot, **_areas_environment(spec)},
            metrics_port=ROBOT_METRICS_PORT,
            robot=robot,
        )
        for robot in spec.robots
    ]
    egos = [
        _ego(spec, place, ego, _standby_environment(spec) if ego == spec.ego else {})
        for ego in spec.all_egos
    ]
    if spec.ego_standby:
        egos.append(_ego(spec, place, spec.ego_standby, {"COADAPT_STANDS_IN_FOR": spec.ego}))
    console = Service(
        name="console",
        role="console",
        host=INFRA,
        argv=(place.python, "-m", "options.console"),
        env=_console_environment(spec, place),
        metrics_port=spec.console_metrics_port,
    )
    prometheus = Service(
        name="prometheus",
        role="prometheus",
        host=INFRA,
        argv=(
            place.prometheus,
            f"--config.file={place.prometheus_config}",
            # Series of an earlier swarm would count in sums for minutes.
            f"--storage.tsdb.path={place.var_dir}/prometheus/{_begun(spec)}",
            f"--storage.tsdb.retention.size={RETENTION}",
            f"--web.listen-address=0.0.0.0:{PROMETHEUS_PORT}",
        ),
        metrics_port=PROMETHEUS_PORT,
    )
    authority = Service(
        name="authority",
        role="authority",
        host=INFRA,
        argv=(place.python, "-m", "deploy.trust"),
        env={
            **_common_environment(
                spec, place, place.router_host, "authority", AUTHORITY_METRICS_PORT
            ),
            "COADAPT_KEYSTORE": f"{place.var_dir}/{KEYSTORE}",
        },
        metrics_port=AUTHORITY_METRICS_PORT,
    )
    trust = [authority] if spec.secure else []
    advice = [gateway] if spec.llm else []
    watch = [console] if spec.console else []
    watch += [prometheus] if spec.prometheus else []
    if spec.grafana:
        watch.append(Service(name="grafana", role="grafana", host=INFRA, argv=()))
    return (*trust, router, controller, *advice, *robots, *egos, *watch)


def identity_path(var_dir: str, common_name: str) -> str:
    """Where a role's identity lies, as the processes see it."""
    return f"{var_dir}/{KEYSTORE}/{ISSUED}/{common_name}"


def ego_metrics_url(spec: SwarmSpec) -> str:
    """Where the ego's metrics answer on the host."""
    scheme = "https" if spec.metrics_tls else "http"
    return f"{scheme}://127.0.0.1:{spec.ego_metrics_port}/metrics"


def authority_path(var_dir: str) -> str:
    """Where the certificate of a swarm's authority lies."""
    return f"{var_dir}/{KEYSTORE}/ca/{CA}"


def inherited(role: Role, environment: Mapping[str, str]) -> dict[str, str]:
    """What a process may take over from the environment of `up`: what is another role's secret
    stays away from it."""
    return {
        name: value
        for name, value in environment.items()
        if all(role == owner or not name.startswith(start) for start, owner in SECRETS.items())
    }


def journal_path(spec: SwarmSpec, var_dir: str, ego: str = "") -> str:
    """An ego's journal: one file for each time that the swarm is started, named by when."""
    return f"{var_dir}/{JOURNAL}/{ego or spec.ego}-{_begun(spec)}.jsonl"


def net_journal_path(spec: SwarmSpec, var_dir: str) -> str:
    """The controller's journal of actions."""
    return f"{var_dir}/{NET}/actions-{_begun(spec)}.jsonl"


def _begun(spec: SwarmSpec) -> str:
    return time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(spec.epoch_ns // 1_000_000_000))


def _ego(spec: SwarmSpec, place: Place, ego: str, part: Mapping[str, str]) -> Service:
    """One ego; `part`: the part that it plays beside another one."""
    return Service(
        name=f"ego-{ego}",
        role="ego",
        host=ego,
        argv=(place.python, "-m", "ego_agent"),
        env=_environment(spec, place, TrustRole("ego", ego).common_name, EGO_METRICS_PORT)
        | {
            "OMP_NUM_THREADS": MANY_EGOS_THREADS if spec.egos else EGO_THREADS,
            "COADAPT_EGO": ego,
            "COADAPT_POLICY": spec.policy,
            "COADAPT_PERIOD_S": str(spec.period_s),
            "COADAPT_Q_MIN": str(spec.q_min),
            "COADAPT_JOURNAL": journal_path(spec, place.var_dir, ego),
            **_range_environment(spec),
            **_areas_environment(spec),
            # What the operator sets is known before anything has been measured.
            **({"COADAPT_LINK_PRIOR_BPS": str(spec.link_bps)} if spec.link_bps else {}),
            **part,
        },
        metrics_port=EGO_METRICS_PORT,
        robot=ego,
    )


def _egos_environment(spec: SwarmSpec) -> dict[str, str]:
    """Of those that have to know every ego."""
    return {"COADAPT_EGO": spec.ego} | ({"COADAPT_EGOS": ",".join(spec.egos)} if spec.egos else {})


def _standby_environment(spec: SwarmSpec) -> dict[str, str]:
    return {"COADAPT_EGO_STANDBY": spec.ego_standby} if spec.ego_standby else {}


def _controller_environment(spec: SwarmSpec, place: Place) -> dict[str, str]:
    """The network controller's settings (`network_controller.settings`)."""
    link = {}
    if spec.link_bps:
        link = {"COADAPT_LINK_BPS": str(spec.link_bps)}
    elif spec.world == "factory" and (steps := link_steps_bps(spec.scenario)) is not None:
        rates, interval_s = steps
        link = {
            "COADAPT_LINK_RATES_BPS": ",".join(map(str, rates)),
            "COADAPT_LINK_INTERVAL_S": str(interval_s),
        }
    return {
        **_site_environment(spec, place, "controller", spec.controller_metrics_port),
        "COADAPT_DRIVER": place.driver,
        **_egos_environment(spec),
        "COADAPT_CELL": spec.cell,
        **_standby_environment(spec),
        "COADAPT_EPOCH_NS": str(spec.epoch_ns),
        "COADAPT_STATE_FILE": f"{place.var_dir}/{NET}/shapes-{_begun(spec)}.json",
        "COADAPT_NET_JOURNAL": net_journal_path(spec, place.var_dir),
        "COADAPT_QOD_PORT": str(spec.qod_port),
        "COADAPT_QOD_SOCKET": place.qod_socket,
        **link,
    }


def _gateway_environment(spec: SwarmSpec, place: Place) -> dict[str, str]:
    """The LLM gateway's settings (`llm_gateway.settings`)."""
    embedded = spec.llm == EMBEDDED
    return {
        **_site_environment(spec, place, "gateway", spec.gateway_metrics_port),
        "COADAPT_LLM_BACKEND": "llamacpp" if embedded else "openai",
        "COADAPT_LLM_MODEL": spec.llm_model,
        "COADAPT_LLM_CACHE": f"{place.var_dir}/{LLM}/answers.sqlite3",
        "COADAPT_LLM_HTTP_PORT": str(spec.llm_port),
        **({} if embedded else {"COADAPT_LLM_URL": spec.llm}),
    }


def _console_environment(spec: SwarmSpec, place: Place) -> dict[str, str]:
    """The console's settings (`options.console.settings`)."""
    return {
        **_site_environment(spec, place, "console", spec.console_metrics_port),
        **_egos_environment(spec),
        **_range_environment(spec),
        "COADAPT_CONSOLE_PORT": str(spec.console_port),
        "COADAPT_CONSOLE_RECORDINGS": f"{place.var_dir}/{RECORDINGS}",
        **(_prometheus_environment(spec, place) if spec.prometheus else {}),
        "COADAPT_WORLD": spec.world,
        "COADAPT_WORLD_ROBOTS": str(spec.room()),
        "COADAPT_WORLD_SEED": str(spec.seed),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def _prometheus_environment(spec: SwarmSpec, place: Place) -> dict[str, str]:
    return {
        "COADAPT_CONSOLE_PROMETHEUS": f"http://127.0.0.1:{place.prometheus_host_port}",
        "COADAPT_CONSOLE_PROMETHEUS_LINK": f"http://127.0.0.1:{spec.prometheus_port}",
    }


def _areas_environment(spec: SwarmSpec) -> dict[str, str]:
    return {"COADAPT_AREAS": "1"} if spec.areas else {}


def _range_environment(spec: SwarmSpec) -> dict[str, str]:
    return {"COADAPT_COMM_RANGE_M": str(spec.comm_range_m)} if spec.comm_range_m else {}


def _site_environment(
    spec: SwarmSpec, place: Place, common_name: str, metrics_port: int
) -> dict[str, str]:
    """What the processes share that serve the site, not one robot."""
    host = place.site_router_host or place.router_host
    return _common_environment(spec, place, host, common_name, metrics_port) | {
        "COADAPT_METRICS_HOST": place.site_metrics_host
    }


def _common_environment(
    spec: SwarmSpec, place: Place, router_host: str, common_name: str, metrics_port: int
) -> dict[str, str]:
    identity = identity_path(place.var_dir, common_name)
    return {
        "COADAPT_SWARM": spec.swarm,
        "COADAPT_ROUTER": router_address(spec, router_host, identity),
        "COADAPT_METRICS_HOST": "0.0.0.0",
        "COADAPT_METRICS_PORT": str(metrics_port),
        **({"COADAPT_METRICS_TLS": "true"} if spec.metrics_tls else {}),
    }


def router_address(spec: SwarmSpec, host: str, identity: str) -> str:
    """The router as a client is told of it, which shows an identity where the swarm is secure."""
    if spec.secure:
        return f"tls/{host}:{spec.router_port}#identity={identity}"
    return f"tcp/{host}:{spec.router_port}"


def _environment(
    spec: SwarmSpec, place: Place, common_name: str, metrics_port: int
) -> dict[str, str]:
    """The settings that the processes which live in the world share (`swarm.process`)."""
    return {
        **_common_environment(spec, place, place.router_host, common_name, metrics_port),
        "COADAPT_WORLD": spec.world,
        "COADAPT_WORLD_DATA": place.data,
        "COADAPT_WORLD_ROBOTS": str(spec.room()),
        "COADAPT_WORLD_SEED": str(spec.seed),
        "COADAPT_WORLD_RINGS": str(spec.rings),
        "COADAPT_WORLD_SCENARIO": spec.scenario,
        "COADAPT_WORLD_CACHE": place.cache,
        "COADAPT_EPOCH_NS": str(spec.epoch_ns),
        # A machine runs many of these processes: one numerical thread each, and none that spins
        # on a core while it waits for others.
        "OMP_NUM_THREADS": "1",
        "OMP_WAIT_POLICY": "PASSIVE",
        "OPENBLAS_NUM_THREADS": "1",
    }


def prometheus_config(
    members: Iterable[Service],
    address: Callable[[Service], str],
    alerts: str,
    targets: str = "",
    *,
    ca: str = "",
    tls: bool = False,
) -> str:
    """Prometheus' configuration (YAML): every service that serves metrics, one job a role, and
    those that joined later, as `Place.targets` tells.

    `address` gives the name or IP address at which Prometheus reaches a service, `alerts` the path
    of `deploy.dashboards.ALERTS` as Prometheus sees it. Targets carry the labels `role`, `robot`
    (of robots and egos) and `instance`, the service's name. `ca`: the certificate of a secure
    swarm's authority, as Prometheus sees it, for those that serve over TLS: with `tls`, all that
    have a certificate; else only such as joined and say so.
    """
    jobs: dict[str, list[dict[str, Any]]] = {}
    for service in members:
        if service.metrics_port is None:
            continue
        labels = {"role": service.role, "instance": service.name}
        if service.robot:
            labels["robot"] = service.robot
        target = f"{address(service)}:{service.metrics_port}"
        jobs.setdefault(service.role, []).append({"targets": [target], "labels": labels})
    # A robot process and the ego name robots in their own metrics: those labels count.
    trusting: dict[str, object] = (
        {"tls_config": {"ca_file": ca, "server_name": SERVER_NAME}} if ca else {}
    )
    scraped: list[dict[str, object]] = [
        {
            "job_name": role,
            "honor_labels": True,
            **({"scheme": "https", **trusting} if tls and role in OVER_TLS else {}),
            "static_configs": group,
        }
        for role, group in jobs.items()
    ]
    config = {
        "global": {
            "scrape_interval": f"{SCRAPE_S}s",
            "scrape_timeout": f"{SCRAPE_S}s",
            "evaluation_interval": f"{EVALUATE_S}s",
        },
        "rule_files": [alerts],
        "scrape_configs": scraped,
    }
    if targets:
        own = "|".join(
            re.escape(one["labels"]["instance"]) for group in jobs.values() for one in group
        )
        joined = {
            "job_name": "joined",
            "honor_labels": True,
            **trusting,
            "file_sd_configs": [{"files": [targets], "refresh_interval": f"{REFRESH_S}s"}],
            # What was started with the swarm is missed when it does not answer.
            "relabel_configs": [
                {"source_labels": ["instance"], "regex": own, "action": "drop"},
            ],
        }
        config["scrape_configs"] = [*scraped, joined]
    text: str = yaml.safe_dump(config, sort_keys=False)
    return text
