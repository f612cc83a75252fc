"""The processes of a swarm, as every runtime starts them."""

from __future__ import annotations

from collections.abc import Mapping

from deploy import environments
from deploy.environments import (
    AUTHORITY_METRICS_PORT,
    EGO_METRICS_PORT,
    ROBOT_METRICS_PORT,
    standby,
)
from deploy.paths import begun, identity_path
from deploy.roster import INFRA, PROMETHEUS_PORT, Place, Service
from deploy.spec import SwarmSpec

ROUTER_METRICS_PORT = 9100
RETENTION = "512MB"


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
        env=environments.of_controller(spec, place),
        metrics_port=spec.controller_metrics_port,
    )
    gateway = Service(
        name="gateway",
        role="gateway",
        host=INFRA,
        argv=(place.python, "-m", "llm_gateway"),
        env=environments.of_gateway(spec, place),
        metrics_port=spec.gateway_metrics_port,
    )
    robots = [
        Service(
            name=f"robot-{robot}",
            role="robot",
            host=robot,
            argv=(place.python, "-m", "robot_agent"),
            env=environments.of_robot(spec, place, robot),
            metrics_port=ROBOT_METRICS_PORT,
            robot=robot,
        )
        for robot in spec.robots
    ]
    egos = [
        _ego(spec, place, ego, standby(spec) if ego == spec.ego else {}) for ego in spec.all_egos
    ]
    if spec.ego_standby:
        egos.append(_ego(spec, place, spec.ego_standby, {"COADAPT_STANDS_IN_FOR": spec.ego}))
    console = Service(
        name="console",
        role="console",
        host=INFRA,
        argv=(place.python, "-m", "options.console"),
        env=environments.of_console(spec, place),
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
            f"--storage.tsdb.path={place.var_dir}/prometheus/{begun(spec)}",
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
        env=environments.of_authority(spec, place),
        metrics_port=AUTHORITY_METRICS_PORT,
    )
    trust = [authority] if spec.secure else []
    advice = [gateway] if spec.llm else []
    watch = [console] if spec.console else []
    watch += [prometheus] if spec.prometheus else []
    if spec.grafana:
        watch.append(Service(name="grafana", role="grafana", host=INFRA, argv=()))
    return (*trust, router, controller, *advice, *robots, *egos, *watch)


def ego_metrics_url(spec: SwarmSpec) -> str:
    """Where the ego's metrics answer on the host."""
    scheme = "https" if spec.metrics_tls else "http"
    return f"{scheme}://127.0.0.1:{spec.ego_metrics_port}/metrics"


def _ego(spec: SwarmSpec, place: Place, ego: str, part: Mapping[str, str]) -> Service:
    """One ego; `part`: the part that it plays beside another one."""
    return Service(
        name=f"ego-{ego}",
        role="ego",
        host=ego,
        argv=(place.python, "-m", "ego_agent"),
        env={**environments.of_ego(spec, place, ego), **part},
        metrics_port=EGO_METRICS_PORT,
        robot=ego,
    )
