"""A swarm as a stack of Docker Swarm: what `docker stack deploy` reads."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import yaml

from deploy import paths, roster, scraping
from deploy.cluster import plan
from deploy.cluster.plan import Cluster, Container
from deploy.docker import compose
from deploy.ports import LOCALHOST
from deploy.roster import Service
from deploy.spec import SwarmSpec
from swarm.errors import DeployError

ROBOT_LABEL, SITE_LABEL = "coadapt.robot", "coadapt.site"
"""Of a node: the robot that it is, and whether it runs what the site has one of."""
Pin = Literal["label", "name"]
"""By what a node is a robot's: its label, or its host name."""
CONSOLE_TOKEN = "COADAPT_CONSOLE_TOKEN"
MAX_NAME = 64
"""Characters of a secret's name, for the engine."""
_COMPOSE_VERSION = "3.9"
"""The oldest that knows all that is used here; engines from 20.10 on read it."""
_RESTART_DELAY = "2s"
_UPDATE: dict[str, Any] = {
    # The old task has ended before the new one begins: an id is never there twice.
    "order": "stop-first",
    "parallelism": 1,
    "monitor": "20s",
}
_LOSES = (
    "an overlay loses the packets' marks (DSCP), so that nothing on the way tells traffic classes "
    "apart, and no controller can shape a host's interface for it; --network host keeps them"
)


def stack_file(
    spec: SwarmSpec,
    cluster: Cluster,
    pin: Pin = "label",
    only: Iterable[str] = (),
    prometheus: str = "",
) -> str:
    """The stack file (YAML) of a swarm.

    `only`: names of services; the others are left out, and `docker stack deploy` leaves them as
    they are. `prometheus`: its configuration, which lies at `config_path` by then.

    Raises DeployError for what a stack cannot have, and for files that cannot be read.
    """
    wanted = plan.containers(spec, cluster)
    only = tuple(only)
    unknown = set(only) - {one.service.name for one in wanted}
    if unknown:
        raise DeployError(
            f"--only {min(unknown)!r} is not a process of this swarm; there are "
            f"{', '.join(one.service.name for one in wanted)}"
        )
    if only:
        wanted = tuple(one for one in wanted if one.service.name in only)
    network = "wire" if cluster.network == "overlay" else "host"
    secrets = {
        _key(one, place): _secret(spec.swarm, one, place, file)
        for one in wanted
        for place, file in one.files.items()
    }
    document = {
        "version": _COMPOSE_VERSION,
        "services": {one.service.name: _service(spec, cluster, pin, one) for one in wanted},
        "networks": {
            network: {"driver": "overlay"}
            if cluster.network == "overlay"
            else {"external": True, "name": "host"}
        },
        **({"secrets": secrets} if secrets else {}),
        **_configs(spec, wanted, prometheus),
        "volumes": {folder: {} for one in wanted for folder in one.folders},
    }
    text: str = yaml.safe_dump(_escaped(document), sort_keys=False)
    return text


def names(spec: SwarmSpec, cluster: Cluster) -> list[str]:
    """The names of the stack's services."""
    return [one.service.name for one in plan.containers(spec, cluster)]


def loses(cluster: Cluster) -> str:
    """What a swarm goes without on the network that was chosen; empty: nothing."""
    return _LOSES if cluster.network == "overlay" else ""


def prometheus_file(spec: SwarmSpec, cluster: Cluster, addresses: Mapping[str, str]) -> str:
    """Prometheus' configuration: on an overlay every service has its name; on the nodes' own
    network a robot's node has one of `addresses`, and the site's that of the router."""

    def address(service: Service) -> str:
        if cluster.network == "overlay":
            return service.name
        if service.role == "prometheus":
            return LOCALHOST
        return addresses[service.robot] if service.robot else cluster.router

    members = [one.service for one in plan.containers(spec, cluster)]
    targets = plan.place_of(spec, cluster).targets
    ca = paths.authority_path(compose.PLACE.var_dir) if spec.secure else ""
    return scraping.prometheus_config(
        members, address, compose.ALERTS, targets, ca=ca, tls=spec.metrics_tls
    )


def config_path(spec: SwarmSpec) -> Path:
    """Where `prometheus_file` has to lie while the stack is deployed."""
    return Path(spec.var_dir, "stack", "prometheus.yml")


def _service(spec: SwarmSpec, cluster: Cluster, pin: Pin, one: Container) -> dict[str, Any]:
    overlay = cluster.network == "overlay"
    labels = {compose.LABEL: spec.swarm, compose.SERVICE_LABEL: one.service.name}
    service: dict[str, Any] = {
        "image": one.image,
        "command": list(one.service.argv),
        "environment": {
            **one.env,
            # A container's own name says nothing.
            "COADAPT_HOST": "{{.Node.Hostname}}",
            **(_off_loopback(one) if overlay else {}),
        },
        "user": f"{one.user}:{one.user}",
        "init": True,
        "read_only": True,
        "cap_drop": ["ALL"],
        **({"cap_add": list(one.capabilities)} if one.capabilities else {}),
        "networks": ["wire" if overlay else "host"],
        "volumes": _volumes(one),
        "logging": compose.CONFINED["logging"],
        "stop_grace_period": f"{plan.ENDS_S}s",
        "labels": labels,
        "deploy": _deploy(pin, one, overlay) | {"labels": labels},
    }
    if one.files:
        service["secrets"] = [
            {
                "source": _key(one, place),
                "target": place,
                "uid": str(one.user),
                "gid": str(one.user),
                "mode": 0o400,
            }
            for place in one.files
        ]
    if one.service.metrics_port is not None:
        asked = [str(one.service.metrics_port), *(["--tls"] if one.tls else [])]
        service["healthcheck"] = {
            "test": ["CMD", "python3", "-m", "swarm.health", *asked],
            "interval": f"{plan.HEALTH_PERIOD_S}s",
            "timeout": f"{plan.HEALTH_TIMEOUT_S}s",
            "retries": plan.HEALTH_RETRIES,
            "start_period": f"{plan.HEALTH_START_S}s",
        }
    if one.service.role == "prometheus":
        service["configs"] = [{"source": "prometheus", "target": compose.PLACE.prometheus_config}]
    if overlay and (ports := _published(spec, one)):
        service["ports"] = [
            # The routing mesh needs IPVS, which not every kernel has: the node's own port.
            {"target": inside, "published": outside, "mode": "host"}
            for inside, outside in ports.items()
        ]
    return service


def _off_loopback(one: Container) -> dict[str, str]:
    """Settings of a task whose loopback nobody else reaches. Raises DeployError for one that would
    answer anybody then."""
    if one.service.role != "console":
        return {}
    if f"{CONSOLE_TOKEN}_FILE" not in one.env:
        raise DeployError(
            "on an overlay the console answers off its node, and needs a token: name a file that "
            f"holds one by {CONSOLE_TOKEN}_FILE, or leave it out by --no-console"
        )
    found = {"COADAPT_CONSOLE_HOST": "0.0.0.0"}
    if "COADAPT_CONSOLE_PROMETHEUS" in one.env:
        found["COADAPT_CONSOLE_PROMETHEUS"] = f"http://prometheus:{roster.PROMETHEUS_PORT}"
        found["COADAPT_CONSOLE_PROMETHEUS_LINK"] = ""
    return found


def _deploy(pin: Pin, one: Container, overlay: bool) -> dict[str, Any]:
    if not one.robot:
        where, mode = f"node.labels.{SITE_LABEL} == true", {"mode": "replicated", "replicas": 1}
    else:
        label = f"node.labels.{ROBOT_LABEL}" if pin == "label" else "node.hostname"
        # Global: the engine never starts it on another node because this one does not answer.
        where, mode = f"{label} == {one.robot}", {"mode": "global"}
    return {
        **mode,
        **({"endpoint_mode": "dnsrr"} if overlay else {}),
        "placement": {"constraints": [where]},
        "resources": {"limits": {"memory": str(one.memory), "pids": plan.PIDS}},
        "restart_policy": {"condition": "any", "delay": _RESTART_DELAY},
        "update_config": _UPDATE | {"failure_action": "rollback"},
        "rollback_config": _UPDATE | {"failure_action": "pause"},
    }


def _volumes(one: Container) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = [
        {"type": "tmpfs", "target": "/tmp", "tmpfs": {"size": plan.TMP_BYTES}}
    ]
    for folder in one.folders:
        there = f"{compose.PLACE.var_dir}/{folder}"
        found.append({"type": "volume", "source": folder, "target": there})
    if one.data:
        there = compose.DATA
        found.append({"type": "bind", "source": one.data, "target": there, "read_only": True})
    return found


def _published(spec: SwarmSpec, one: Container) -> Mapping[int, int]:
    """Ports inside and on its node, on an overlay."""
    if one.service.role == "router":
        return {port: port for port in one.ports}
    if one.service.role == "console":
        return {spec.console_port: spec.console_port}
    return {}


def _configs(spec: SwarmSpec, wanted: Iterable[Container], prometheus: str) -> dict[str, Any]:
    if not any(one.service.role == "prometheus" for one in wanted):
        return {}
    digest = hashlib.sha256(prometheus.encode()).hexdigest()[:12]
    name = _named(spec.swarm, "prometheus", digest)
    return {"configs": {"prometheus": {"file": str(config_path(spec)), "name": name}}}


def _key(one: Container, place: str) -> str:
    """What a secret is called within the stack file."""
    return f"{one.common_name or one.service.name}-{Path(place).name}"


def _secret(swarm: str, one: Container, place: str, file: Path) -> dict[str, str]:
    """A secret that the engine takes from a file. It never changes one: what is renewed has another
    name, and whoever uses it is started anew."""
    try:
        digest = hashlib.sha256(file.read_bytes()).hexdigest()[:12]
    except OSError as error:
        raise DeployError(f"{file}, a secret of {one.service.name}: {error.strerror}") from error
    return {"file": str(file), "name": _named(swarm, _key(one, place), digest)}


def _named(swarm: str, key: str, digest: str) -> str:
    return f"{f'{swarm}-{key}'[: MAX_NAME - len(digest) - 1]}-{digest}"


def _escaped(value: Any) -> Any:
    """`docker stack deploy` puts variables in: a dollar sign that means itself is written twice."""
    if isinstance(value, dict):
        return {key: _escaped(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_escaped(one) for one in value]
    return value.replace("$", "$$") if isinstance(value, str) else value
