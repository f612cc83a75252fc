"""A swarm on three Docker engines in Swarm mode, from a local registry, by `stack deploy`."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from deploy.cluster.stack import ROBOT_LABEL, SITE_LABEL
from deploy.docker.image import ensure_image
from deploy.progress import say
from deploy.runtimes.docker import DockerRuntime
from tests.support import docker_nodes
from tests.support.command_line import Cli, command_line
from tests.support.deploy_support import await_
from tests.support.docker_nodes import REGISTRY, Node, Site, site
from tests.support.paths import REPOSITORY

# The first one builds the image and brings it into the registry.
READY_S = 900
START_S = 180.0
"""From `stack deploy` to decisions with all robots, on a busy machine."""
CUT_S = 90.0
"""A node that does not answer is lost for the managers after some seconds, and is back later."""
STACK = "coadapt"
ROBOTS = ("R1", "R2", "R3")
pytestmark = pytest.mark.timeout(READY_S)


@pytest.fixture(scope="module")
def image() -> str:
    """The project's image, as this machine's engine calls it."""
    why_not = docker_nodes.why_not() or DockerRuntime().available()
    if why_not is not None:
        pytest.skip(why_not)
    return ensure_image(say)


@pytest.fixture(scope="module")
def wire(image: str) -> Iterator[Site]:
    """Three engines that are one swarm of Docker's; the first one is its manager, and the second
    and third know the image from the start."""
    with site(REPOSITORY / "build" / "registry") as made:
        first = made.add("n1")
        docker_nodes.publish(image, first)
        for name in ("n2", "n3"):
            made.add(name, images_of=first)
        first.docker(
            *("swarm", "init", "--advertise-addr", first.address),
            *("--default-addr-pool", "10.88.0.0/16"),
        )
        token = first.docker("swarm", "join-token", "--quiet", "worker")
        for node in made.nodes[1:]:
            node.docker("swarm", "join", "--token", token, f"{first.address}:2377")
        yield made


@pytest.fixture(scope="module")
def manager(wire: Site) -> Node:
    return wire.nodes[0]


@pytest.fixture(scope="module")
def cli(image: str, manager: Node) -> Iterator[Cli]:
    """Runs `coadapt stack` as an operator does, at the manager's engine."""
    always = ("--robots", str(len(ROBOTS)), "--rings", "16", "--policy", "static-early")
    with command_line(
        *("--router", manager.address, *always),
        timeout_s=120,
        DOCKER_HOST=f"unix://{manager.socket}",
        COADAPT_IMAGE=f"{REGISTRY}/{image}",
    ) as run:
        yield run


def test_a_swarm_without_nodes_is_told_so(wire: Site, cli: Cli) -> None:
    done = cli("stack", "--check")
    assert done.returncode == 1
    for robot in ROBOTS:
        assert f"robot {robot} has no node" in done.stderr
    assert "the router has no node" in done.stderr


@pytest.fixture(scope="module")
def swarm(wire: Site, manager: Node, cli: Cli) -> Site:
    """A robot on each node, the ego and the site on the first one, and all robots chosen."""
    for node, robot in zip(wire.nodes, ROBOTS, strict=True):
        manager.docker("node", "update", "--label-add", f"{ROBOT_LABEL}={robot}", node.name)
    manager.docker("node", "update", "--label-add", f"{SITE_LABEL}=true", manager.name)
    stack = cli("stack")
    assert stack.returncode == 0, stack.stderr
    manager.docker("stack", "deploy", "--compose-file", "-", STACK, stdin=stack.stdout)
    await_(lambda: fused(manager) == {"R2", "R3"}, "both other robots are fused", START_S)
    return wire


def fused(manager: Node) -> set[str]:
    """The robots of whose answers the ego has received bytes, from its metrics."""
    return {robot for robot, count in received(manager).items() if count > 0}


def received(manager: Node) -> dict[str, float]:
    """Bytes that the ego has received, by robot."""
    found: dict[str, float] = {}
    for line in got(manager, f"{manager.address}:9102/metrics"):
        if line.startswith("coadapt_ego_received_bytes_total{"):
            robot = line.partition('robot="')[2].partition('"')[0]
            found[robot] = found.get(robot, 0.0) + float(line.rpartition(" ")[2])
    return found


def got(node: Node, url: str) -> list[str]:
    """The lines that are served over HTTP in a node's network; none while nobody answers."""
    code = (
        f"import urllib.request as u; print(u.urlopen('http://{url}', timeout=5).read().decode())"
    )
    try:
        return node.run("python3", "-c", code).splitlines()
    except AssertionError:
        return []


def running(node: Node) -> dict[str, str]:
    """The containers that run on a node: their ids by process."""
    form = '{{.Label "coadapt.service"}} {{.ID}}'
    lines = node.docker("ps", "--filter", "label=coadapt.swarm", "--format", form)
    return dict(line.split() for line in lines.splitlines())


def test_each_node_runs_its_robot_and_all_of_it_is_well(swarm: Site, cli: Cli) -> None:
    for node, robot in zip(swarm.nodes, ROBOTS, strict=True):
        robots = {name for name in running(node) if name.startswith("robot-")}
        assert robots == {f"robot-{robot}"}
    assert {"router", "ego-R1", "console"} < set(running(swarm.nodes[0]))

    def well() -> bool:
        return cli("stack", "--check").returncode == 0

    await_(well, "every task runs and is healthy", START_S)


def test_prometheus_finds_every_process(swarm: Site, manager: Node) -> None:
    def up() -> set[str]:
        answer = json.loads("".join(got(manager, "127.0.0.1:9090/api/v1/targets")) or "{}")
        targets = answer.get("data", {}).get("activeTargets", ())
        return {one["labels"]["instance"] for one in targets if one["health"] == "up"}

    robots = {f"robot-{robot}" for robot in ROBOTS}
    wanted = robots | {"router", "ego-R1", "console", "prometheus"}
    await_(lambda: up() == wanted, "every process is a target that is up")


def test_a_task_is_confined_and_holds_its_own_certificate_only(swarm: Site) -> None:
    node = swarm.nodes[1]
    container = running(node)["robot-R2"]
    facts: dict[str, Any] = json.loads(node.docker("inspect", container))[0]
    host = facts["HostConfig"]
    assert host["NetworkMode"] == "host"
    assert host["ReadonlyRootfs"]
    assert host["CapDrop"] == ["ALL"]
    assert not host["CapAdd"]
    assert (host["Memory"], host["PidsLimit"]) == (1 << 30, 512)
    held = node.docker("exec", container, "ls", "/var/coadapt/keystore/issued")
    assert held == "R2"
    assert node.docker("exec", container, "id", "--user") == "10001"
    with pytest.raises(AssertionError, match="Read-only file system"):
        node.docker("exec", container, "touch", "/app/something")


def test_a_node_that_is_cut_off_goes_on_and_is_chosen_again_and_never_twice(
    swarm: Site, manager: Node
) -> None:
    node = swarm.nodes[2]
    before = running(node)["robot-R3"]
    swarm.cut(node)

    def lost() -> bool:
        state = manager.docker("node", "inspect", "--format", "{{.Status.State}}", node.name)
        return state == "down"

    try:
        await_(lost, "the managers know that it is gone", CUT_S)
        others = {name for one in swarm.nodes[:2] for name in running(one)}
        assert "robot-R3" not in others, "its twin lives"
        assert running(node)["robot-R3"] == before
        had = received(manager)["R2"]
        await_(lambda: received(manager)["R2"] > had, "the ego goes on with R2")
        had = received(manager)["R3"]
    finally:
        swarm.cut(node, whole=True)
    await_(lambda: received(manager)["R3"] > had, "R3 is fused again", START_S)
    assert not {"robot-R3"} & {name for one in swarm.nodes[:2] for name in running(one)}


def test_without_a_registry_what_is_missing_is_told_and_what_is_there_goes_on(
    swarm: Site, manager: Node, cli: Cli
) -> None:
    swarm.stop_registry()
    before = running(manager)
    missing = f"{REGISTRY}/coadapt-edge:never"
    done = cli("stack", "--only", "robot-R2", "--image", missing)
    assert done.returncode == 0, done.stderr
    manager.docker("stack", "deploy", "--compose-file", "-", STACK, stdin=done.stdout)

    def told() -> bool:
        said = cli("stack", "--check").stderr
        return "robot-R2 does not run on n2: " in said and "coadapt-edge:never" in said

    await_(told, "the engine's reason is passed on", CUT_S)
    had = received(manager)["R3"]
    await_(lambda: received(manager)["R3"] > had, "the ego goes on with R3")
    assert running(manager) == before
    had = received(manager)["R2"]
    await_(lambda: received(manager)["R2"] > had, "the engine goes back to what ran", START_S)


def test_removing_the_stack_leaves_nothing_but_journals_and_places(
    swarm: Site, manager: Node
) -> None:
    assert manager.docker("secret", "ls", "--quiet")
    manager.docker("stack", "rm", STACK)

    def left() -> list[str]:
        found = [f"{n.name}: {c}" for n in swarm.nodes for c in n.docker("ps", "-aq").split()]
        for kind in ("service", "secret", "config"):
            found += manager.docker(kind, "ls", "--quiet").split()
        names = "{{.Name}} {{.Driver}}"
        networks = [n.docker("network", "ls", "--format", names) for n in swarm.nodes]
        return found + [line for own in networks for line in own.splitlines() if STACK in line]

    await_(lambda: not left(), "containers, services, secrets and networks are gone", CUT_S)
    volumes = manager.docker("volume", "ls", "--quiet").split()
    assert sorted(volumes) == [f"{STACK}_{name}" for name in ("journal", "prometheus", "site")]
    shown = [
        "docker",
        "--host",
        f"unix://{manager.socket}",
        "volume",
        "inspect",
        f"{STACK}_journal",
    ]
    (volume,) = json.loads(subprocess.run(shown, capture_output=True, check=True).stdout)
    assert list(Path(volume["Mountpoint"]).glob("R1-*.jsonl"))
