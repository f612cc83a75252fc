"""The compose project of a swarm: one container a process, all on one bridge network."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import zlib
from pathlib import Path
from typing import Any

import yaml

from deploy import environments, paths, roster, scraping
from deploy.docker import grafana
from deploy.ports import LOCALHOST
from deploy.roster import Place, Service
from deploy.services import services
from deploy.spec import SwarmSpec
from swarm.errors import DeployError

LABEL = "coadapt.swarm"
RUN_DIR_LABEL = "coadapt.run_dir"
"""By which a swarm of somebody else that has the same name is told."""
SERVICE_LABEL = "coadapt.service"
PLACE = Place(
    listen_host="0.0.0.0",
    router_host="router",
    var_dir="/var/coadapt",
    prometheus_config="/etc/coadapt/prometheus.yml",
)
TARGETS = f"{PLACE.var_dir}/{paths.TARGETS}/joined.json"
ALERTS = "/app/deploy/dashboards/alerts.yml"
"""Where the image has them, beside the rest of the source (Dockerfile)."""
ENGINE_SOCKET = "/var/run/docker.sock"
CONTROLLER: dict[str, Any] = {
    "network_mode": "host",
    # It shapes the host's ends of the containers' links, finds them through the engine's socket,
    # and writes to the user's directory.
    "user": "0:0",
    "cap_add": ["NET_ADMIN", "DAC_OVERRIDE"],
}
GATEWAY: dict[str, Any] = {
    # A model server on this host answers on its loopback.
    "network_mode": "host",
}
CONSOLE: dict[str, Any] = {
    # Its page sends the host's own name and port, which it checks.
    "network_mode": "host",
}
CONFINED: dict[str, Any] = {
    "cap_drop": ["ALL"],
    "security_opt": ["no-new-privileges:true"],
    "read_only": True,
    # Counted as the container's memory. What may grow has a folder of the swarm's instead.
    "tmpfs": ["/tmp:mode=1777,size=64m"],
    "pids_limit": 512,
    "logging": {"driver": "json-file", "options": {"max-size": "10m", "max-file": "3"}},
}
"""What no process of a swarm needs, it cannot have."""
MEMORY: dict[roster.Role, str] = {
    "router": "1g",
    "controller": "512m",
    "gateway": "4g",
    "robot": "1g",
    "ego": "3g",
    "console": "1g",
    "authority": "256m",
    "prometheus": "2g",
    "grafana": "1g",
}
"""Several times what each takes; a process that leaks ends alone."""
FOLDERS: dict[roster.Role, str] = {
    "ego": paths.JOURNAL,
    "controller": paths.NET,
    "gateway": paths.LLM,
    "console": paths.SITE,
    "authority": paths.KEYSTORE,
    "prometheus": "prometheus",
}
"""What each may write of the swarm's directory."""
CACHES: dict[roster.Role, dict[str, str]] = {
    # A faster or joined form of the embedded model, of a hundred megabytes and more.
    "gateway": {"XDG_CACHE_HOME": f"{PLACE.var_dir}/{paths.LLM}/cache"},
}
DATA, CACHE, KEY = "/data", "/cache", "/run/secrets/llm-api-key"
SECRETS = {
    name: KEY if name == environments.API_KEY else f"/run/secrets/{name.lower()}"
    for name in environments.KEPT
}
"""Where a container finds the file that a setting names on the host."""
_IN_HOST_NETWORK = ("controller", "gateway", "console")
NOT_FOR_PROCESSES = frozenset(
    {
        *("COADAPT_BASE_IMAGE", "COADAPT_CONFIG", "COADAPT_DATA", "COADAPT_GRAFANA_IMAGE"),
        *("COADAPT_REQUIRE", "COADAPT_RUN_DIR"),
    }
)
"""They steer `up` and the tests, or name a path that a container does not have."""


def place_of(spec: SwarmSpec, gateway: str = LOCALHOST) -> Place:
    """Where the processes of this swarm find things inside their containers.

    Controller, LLM gateway and console live in the host's network; containers reach them at
    `gateway`, the host's address on Docker's bridge.
    """
    return Place(
        driver="docker",
        site_router_host=LOCALHOST,
        site_metrics_host=gateway,
        listen_host=PLACE.listen_host,
        router_host=PLACE.router_host,
        var_dir=PLACE.var_dir,
        prometheus_config=PLACE.prometheus_config,
        data=DATA if spec.data else "",
        cache=CACHE if spec.cache else "",
        prometheus_host_port=spec.prometheus_port,
        targets=TARGETS,
    )


def project_of(swarm: str) -> str:
    """The compose project's name; compose allows no capitals, swarms do."""
    lower = re.sub(r"[^a-z0-9_-]", "", swarm.lower())
    return (
        f"coadapt-{lower}" if lower == swarm else f"coadapt-{lower}-{zlib.crc32(swarm.encode()):x}"
    )


def compose_file(spec: SwarmSpec, image: str, llm_image: str, gateway: str) -> str:
    """The compose file (YAML) of a swarm that runs from `image`, its LLM gateway from `llm_image`;
    see `place_of`."""
    members = services(spec, place_of(spec, gateway))
    special = {
        "controller": CONTROLLER,
        "gateway": GATEWAY,
        "console": CONSOLE,
        "grafana": grafana.container(spec),
    }
    document = {
        "services": {
            m.name: _container(spec, m, llm_image if m.role == "gateway" else image)
            | special.get(m.role, {})
            for m in members
        },
        "networks": {"swarm": {"driver": "bridge", "labels": {LABEL: spec.swarm}}},
    }
    text: str = yaml.safe_dump(document, sort_keys=False)
    return text


def prometheus_file(spec: SwarmSpec) -> str:
    """Prometheus' configuration; it reaches each container by its name."""
    return scraping.prometheus_config(
        services(spec, place_of(spec)),
        lambda service: service.name,
        ALERTS,
        place_of(spec).targets,
        ca=paths.authority_path(PLACE.var_dir) if spec.secure else "",
        tls=spec.metrics_tls,
    )


def _container(spec: SwarmSpec, service: Service, image: str) -> dict[str, Any]:
    container: dict[str, Any] = {
        "image": image,
        **({"command": list(service.argv)} if service.argv else {}),
        "environment": {
            # A container's own name says nothing.
            "COADAPT_HOST": os.environ.get("COADAPT_HOST") or socket.gethostname(),
            **_settings(service),
            **service.env,
            "HOME": "/tmp",
            **CACHES.get(service.role, {}),
        },
        "user": f"{os.getuid()}:{os.getgid()}",
        "init": True,
        "mem_limit": MEMORY[service.role],
        **CONFINED,
        **({} if service.role in _IN_HOST_NETWORK else {"networks": ["swarm"]}),
        "labels": {
            LABEL: spec.swarm,
            SERVICE_LABEL: service.name,
            RUN_DIR_LABEL: spec.run_dir,
        },
        "restart": "unless-stopped" if service.restart == "always" else "no",
        "stop_grace_period": "5s",
        "volumes": _volumes(spec, service),
    }
    published = _published(spec, service)
    if published:
        container["ports"] = published
    if service.role == "prometheus":
        container["extra_hosts"] = [f"{name}:host-gateway" for name in _IN_HOST_NETWORK]
    if service.role not in ("router", "authority"):
        container["depends_on"] = ["router"]
    return container


def _settings(service: Service) -> dict[str, str | None]:
    """Settings that `up` has no option for, from the caller's environment. A key is not written
    down: for None compose takes the value from its own environment."""
    if service.role not in ("robot", "ego", "controller", "gateway", "console", "authority"):
        return {}
    found: dict[str, str | None] = {
        name: value
        for name, value in environments.inherited(service.role, os.environ).items()
        if name.startswith("COADAPT_") and name not in NOT_FOR_PROCESSES
    }
    for secret in environments.KEPT:
        if secret in found:
            found[secret] = None
        if found.get(f"{secret}_FILE"):
            found[f"{secret}_FILE"] = SECRETS[secret]
    return found


def _volumes(spec: SwarmSpec, service: Service) -> list[str]:
    volumes = []
    if service.role == "controller":
        volumes.append(f"{ENGINE_SOCKET}:{ENGINE_SOCKET}")
    own = environments.inherited(service.role, os.environ)
    for secret, place in SECRETS.items():
        if file := own.get(f"{secret}_FILE"):
            volumes.append(f"{Path(file).absolute()}:{place}:ro")
    if folder := FOLDERS.get(service.role):
        volumes.append(f"{spec.var_dir}/{folder}:{PLACE.var_dir}/{folder}")
    # The authority has the whole keystore, its own identity in it.
    if spec.secure and service.common_name and service.role != "authority":
        here = paths.identity_path(spec.var_dir, service.common_name)
        there = paths.identity_path(PLACE.var_dir, service.common_name)
        volumes.append(f"{here}:{there}:ro")
    targets = f"{spec.var_dir}/{paths.TARGETS}:{PLACE.var_dir}/{paths.TARGETS}"
    if service.role == "router":
        volumes.append(targets)
    if service.role == "console":
        volumes.append(f"{spec.var_dir}/{paths.RECORDINGS}:{PLACE.var_dir}/{paths.RECORDINGS}:ro")
    if service.role == "prometheus":
        volumes.append(f"{spec.run_dir}/prometheus.yml:{PLACE.prometheus_config}:ro")
        volumes.append(f"{targets}:ro")
        if spec.secure:
            here, there = map(paths.authority_path, (spec.var_dir, PLACE.var_dir))
            volumes.append(f"{here}:{there}:ro")
    if service.role in ("ego", "robot") and spec.data:
        volumes.append(f"{spec.data}:{DATA}:ro")
    if service.role in ("ego", "robot") and spec.cache:
        volumes.append(f"{spec.cache}:{CACHE}")
    return volumes


def _published(spec: SwarmSpec, service: Service) -> list[str]:
    """Ports on the host: the router's also on the address where others reach it, the ego's metrics
    and Prometheus on the loopback."""
    if service.role == "router":
        ports = range(spec.router_port, spec.router_port + 3)
        hosts = dict.fromkeys(filter(None, (LOCALHOST, spec.listen)))
        return [f"{host}:{port}:{port}" for host in hosts for port in ports]
    if service.role == "ego" and service.robot == spec.ego:
        return [f"127.0.0.1:{spec.ego_metrics_port}:{service.metrics_port}"]
    if service.role == "prometheus":
        return [f"127.0.0.1:{spec.prometheus_port}:{service.metrics_port}"]
    return []


def compose_command() -> list[str] | None:
    """`docker compose` (v2) or `docker-compose` (v1), whichever is there, else None."""
    if shutil.which("docker"):
        probe = subprocess.run(
            ["docker", "compose", "version"], capture_output=True, timeout=30, check=False
        )
        if probe.returncode == 0:
            return ["docker", "compose"]
    return ["docker-compose"] if shutil.which("docker-compose") else None


def start(spec: SwarmSpec, file: Path) -> None:
    """Creates and starts the project's containers. Raises DeployError with compose's words."""
    command = compose_command()
    if command is None:
        raise DeployError("compose is missing: install docker-compose or Docker's compose plugin")
    done = subprocess.run(
        [*command, "--project-name", project_of(spec.swarm), "--file", str(file), "up", "--detach"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    if done.returncode != 0:
        tail = "\n".join(done.stderr.strip().splitlines()[-10:])
        raise DeployError(f"compose could not start the swarm:\n{tail}")
