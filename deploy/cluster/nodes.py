"""What is amiss with a stack, asked of the engine: nodes without or with too many robots, and tasks
that do not run."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from deploy.cluster.stack import ROBOT_LABEL, SITE_LABEL, Pin
from deploy.docker import compose
from deploy.spec import SwarmSpec
from swarm.errors import DeployError

ASK_S = 60.0


def problems(spec: SwarmSpec, names: Iterable[str], pin: Pin) -> list[str]:
    """What keeps a swarm from running, a sentence each. Raises DeployError where no manager of a
    swarm of Docker's answers."""
    found = node_problems(spec, _nodes(), pin)
    label = f"{compose.LABEL}={spec.swarm}"
    listed = _docker("service", "ls", "--filter", f"label={label}", "--quiet").split()
    if not listed:
        return found
    services = json.loads(_docker("service", "inspect", *listed))
    short = {one["ID"]: one["Spec"]["Labels"][compose.SERVICE_LABEL] for one in services}
    lines = _docker(
        *("service", "ps", "--no-trunc", "--format"),
        '{"name": {{json .Name}}, "node": {{json .Node}}, "state": {{json .CurrentState}}, '
        '"error": {{json .Error}}}',
        *listed,
    )
    tasks = [json.loads(line) for line in lines.splitlines()]
    full = {short[one["ID"]]: one["Spec"]["Name"] for one in services}
    return found + task_problems({name: full.get(name, "") for name in names}, tasks)


def addresses(spec: SwarmSpec, pin: Pin) -> dict[str, str]:
    """The address of each robot's node, for Prometheus. Raises DeployError where a robot has none,
    or two."""
    without = "; or leave it out by --no-prometheus"
    return {
        robot: _address(node) for robot, node in _own(spec, pin, "Prometheus has", without).items()
    }


def hosts(spec: SwarmSpec, pin: Pin) -> dict[str, str]:
    """The address of each robot's node that is not the site's, for routers of their own. Raises
    DeployError where a robot has none, or two."""
    return {
        robot: _address(node)
        for robot, node in _own(spec, pin, "with --mesh routers have", "").items()
        if _labels(node).get(SITE_LABEL) != "true"
    }


def _own(spec: SwarmSpec, pin: Pin, who: str, remedy: str) -> dict[str, Mapping[str, Any]]:
    nodes = _nodes()
    found: dict[str, Mapping[str, Any]] = {}
    for robot in spec.robots:
        own = [node for node in nodes if robot == _robot(node, pin)]
        if len(own) != 1:
            raise DeployError(
                f"{who} to know robot {robot}'s node, and it has {len(own)}: "
                f"`coadapt stack --check` says more{remedy}"
            )
        found[robot] = own[0]
    return found


def node_problems(spec: SwarmSpec, nodes: Sequence[Mapping[str, Any]], pin: Pin) -> list[str]:
    """What is amiss with the nodes that `docker node inspect` tells of."""
    found = []
    for robot in spec.robots:
        own = [_host(node) for node in nodes if robot == _robot(node, pin)]
        if not own:
            remedy = (
                f"`docker node update --label-add {ROBOT_LABEL}={robot} NODE`"
                if pin == "label"
                else f"no node's host name is {robot}"
            )
            found.append(f"robot {robot} has no node: {remedy}")
        if len(own) > 1:
            found.append(
                f"robot {robot} has {len(own)} nodes, {', '.join(own)}, and each would run it: "
                "an id must be there once"
            )
    site = [_host(node) for node in nodes if _labels(node).get(SITE_LABEL) == "true"]
    if not site:
        remedy = f"`docker node update --label-add {SITE_LABEL}=true NODE`"
        found.append(f"the router has no node: {remedy}")
    if len(site) > 1:
        found.append(
            f"{', '.join(site)} have the label {SITE_LABEL}: the router is to have one address"
        )
    for node in nodes:
        if node["Status"]["State"] != "ready":
            found.append(f"node {_host(node)} is {node['Status']['State']}")
        elif node["Spec"]["Availability"] != "active":
            found.append(f"node {_host(node)} is set to {node['Spec']['Availability']}")
    return found


def task_problems(services: Mapping[str, str], tasks: Sequence[Mapping[str, str]]) -> list[str]:
    """What is amiss with tasks, newest first, that `docker service ps` tells of. `services`: the
    name that each process has as a service; empty: it was not deployed."""
    found = []
    for name, service in services.items():
        own = [task for task in tasks if service and task["name"].startswith(f"{service}.")]
        if any(task["state"].startswith("Running") for task in own):
            continue
        told = next((task for task in own if task["error"]), None)
        if told is not None:
            found.append(f"{name} does not run on {told['node'] or 'any node'}: {told['error']}")
        elif own:
            found.append(f"{name} does not run yet: {own[0]['state']}")
        else:
            found.append(f"{name} has no task" if service else f"{name} is not deployed")
    return found


def _nodes() -> list[dict[str, Any]]:
    ids = _docker("node", "ls", "--quiet").split()
    found: list[dict[str, Any]] = json.loads(_docker("node", "inspect", *ids))
    return found


def _address(node: Mapping[str, Any]) -> str:
    """A manager may not know its own by that name."""
    known = str(node["Status"].get("Addr") or "0.0.0.0")
    if known != "0.0.0.0":
        return known
    return str(node["ManagerStatus"]["Addr"]).rpartition(":")[0]


def _host(node: Mapping[str, Any]) -> str:
    return str(node["Description"]["Hostname"])


def _labels(node: Mapping[str, Any]) -> Mapping[str, str]:
    return node["Spec"].get("Labels") or {}


def _robot(node: Mapping[str, Any], pin: Pin) -> str | None:
    return _labels(node).get(ROBOT_LABEL) if pin == "label" else _host(node)


def _docker(*arguments: str) -> str:
    try:
        done = subprocess.run(
            ["docker", *arguments], capture_output=True, text=True, timeout=ASK_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DeployError(f"docker {' '.join(arguments[:2])} did not run: {error}") from error
    if done.returncode != 0:
        raise DeployError(f"docker {' '.join(arguments[:2])}: {done.stderr.strip()}")
    return done.stdout
