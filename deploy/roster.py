"""What a swarm consists of: processes, and what runtimes differ in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from swarm.trust.roles import Role as TrustRole

Role = Literal[
    "router", "controller", "gateway", "robot", "ego", "console", "authority", "prometheus",
    "grafana",
]  # fmt: skip
INFRA = "infra"
PROMETHEUS_PORT = 9090


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
            case "router":
                return TrustRole("router", self.robot).common_name
            case "authority" | "controller" | "gateway" | "console":
                return self.role
        return ""
