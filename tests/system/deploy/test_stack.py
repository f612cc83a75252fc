"""A swarm on three Docker engines in Swarm mode, from a local registry, by `stack deploy`."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from deploy.cluster.stack import ROBOT_LABEL, SITE_LABEL
from deploy.docker.image import ensure_image
from deploy.progress import say
from deploy.runtimes.docker import DockerRuntime
from deploy.trust.keystore import Keystore
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
MOVED = ("--ego", "R3", "--ego-standby", "R2")
"""Neither on the site's node."""
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
    roster = ("--robots", str(len(ROBOTS)), "--world-robots", "4", "--rings", "16", "--mesh")
    with command_line(
        *("--router", manager.address, *roster, "--policy", "static-early"),
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


def fused(node: Node) -> set[str]:
    """The robots of whose answers the ego on a node has received bytes, from its metrics."""
    return {robot for robot, count in received(node).items() if count > 0}


def received(node: Node) -> dict[str, float]:
    """Bytes that the ego on a node has received, by robot."""
    found: dict[str, float] = {}
    for labels, value in metric(node, 9102, "coadapt_ego_received_bytes_total"):
        robot = labels.partition('robot="')[2].partition('"')[0]
        found[robot] = found.get(robot, 0.0) + value
    return found


def metric(node: Node, port: int, name: str) -> list[tuple[str, float]]:
    """Labels and values of a metric of a process of a node."""
    return [
        (line.removeprefix(name).rpartition(" ")[0], float(line.rpartition(" ")[2]))
        for line in got(node, f"{node.address}:{port}/metrics")
        if line.startswith((f"{name}{{", f"{name} "))
    ]


def scraped(manager: Node, label: str) -> set[tuple[str, str]]:
    """A label of each of Prometheus' targets, and how it is."""
    answer = json.loads("".join(got(manager, "127.0.0.1:9090/api/v1/targets")) or "{}")
    targets = answer.get("data", {}).get("activeTargets", ())
    return {(one["labels"].get(label, ""), one["health"]) for one in targets}


def keystore(cli: Cli) -> Keystore:
    """The one from which the stack's certificates come."""
    written = yaml.safe_load(cli("stack").stdout)["secrets"]["R2-cert.pem"]["file"]
    return Keystore(Path(written).parents[2])


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
    for node, robot in zip(swarm.nodes[1:], ROBOTS[1:], strict=True):
        assert set(running(node)) == {f"robot-{robot}", f"router-{robot}"}

    def well() -> bool:
        return cli("stack", "--check").returncode == 0

    await_(well, "every task runs and is healthy", START_S)


def test_prometheus_finds_every_process(swarm: Site, manager: Node) -> None:
    def up() -> set[str]:
        return {name for name, health in scraped(manager, "instance") if health == "up"}

    robots = {f"robot-{robot}" for robot in ROBOTS}
    routers = {"router", "router-R2", "router-R3"}
    wanted = robots | routers | {"ego-R1", "console", "prometheus"}
    await_(lambda: up() == wanted, "every process is a target that is up")


def test_a_robot_that_joins_by_hand_is_fused_and_scraped(
    swarm: Site, manager: Node, cli: Cli, tmp_path: Path
) -> None:
    node = swarm.nodes[1]
    folder = keystore(cli).issue("R4").folder
    join = ("join", f"tls/{node.address}:7447", "--robot", "R4", "--cert", str(folder))
    command = (sys.executable, "-m", "coadapt.main", *join, "--metrics", f"{node.address}:9111")
    with (
        open(tmp_path / "log", "wb") as log,
        subprocess.Popen(
            ["nsenter", f"--net=/proc/{node.pid}/ns/net", "--", *command], stdout=log, stderr=log
        ) as process,
    ):
        try:
            await_(lambda: "R4" in fused(manager), "R4 is fused", START_S)
            await_(lambda: ("R4", "up") in scraped(manager, "robot"), "and scraped", START_S)
        finally:
            process.terminate()
    await_(lambda: ("R4", "up") not in scraped(manager, "robot"), "it is scraped no more")


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


def test_a_new_certificate_comes_with_a_new_task_of_its_process_alone(
    swarm: Site, manager: Node, cli: Cli
) -> None:
    node = swarm.nodes[1]
    before = [running(one) for one in swarm.nodes]

    def certificate(container: str) -> str:
        return node.docker("exec", container, "cat", "/var/coadapt/keystore/issued/R2/cert.pem")

    old = certificate(before[1]["robot-R2"])
    keystore(cli).renew("R2")
    stack = cli("stack", "--only", "robot-R2")
    assert stack.returncode == 0, stack.stderr
    manager.docker("stack", "deploy", "--compose-file", "-", STACK, stdin=stack.stdout)

    def new() -> str:
        found = running(node).get("robot-R2", "")
        return "" if found == before[1]["robot-R2"] else found

    container = await_(new, "R2 runs anew", START_S)
    assert certificate(container) != old
    had = received(manager)["R2"]
    await_(lambda: received(manager)["R2"] > had, "R2 is fused again", START_S)
    assert [running(one) for one in swarm.nodes] == [
        before[0],
        before[1] | {"robot-R2": container},
        before[2],
    ]


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


@pytest.fixture(scope="module")
def moved(swarm: Site, manager: Node, cli: Cli) -> Site:
    """The ego is R3 now, on the third node, and R2's stands by."""
    stack = cli("stack", *MOVED)
    assert stack.returncode == 0, stack.stderr
    deploy = ("stack", "deploy", "--prune", "--compose-file", "-", STACK)
    manager.docker(*deploy, stdin=stack.stdout)
    await_(lambda: fused(swarm.nodes[2]) == {"R1", "R2"}, "R3 fuses both others", START_S)
    await_(lambda: leads(swarm.nodes[1]) == 0.0, "R2's ego stands by", START_S)
    return swarm


def leads(node: Node) -> float | None:
    """1 where the ego of a node decides, 0 where it stands by, None where there is none."""
    found = [value for _, value in metric(node, 9102, "coadapt_ego_leads")]
    return found[0] if found else None


def test_an_ego_is_moved_by_deploying_again(moved: Site) -> None:
    names = [{name for name in running(node) if name.startswith("ego")} for node in moved.nodes]
    assert names == [set(), {"ego-R2"}, {"ego-R3"}]


def test_the_standby_decides_while_the_egos_node_is_lost(moved: Site) -> None:
    _, standby, lost = moved.nodes
    moved.cut(lost)
    try:
        await_(lambda: leads(standby) == 1.0, "R2's ego decides", CUT_S)
        had = received(standby).get("R1", 0.0)
        await_(lambda: received(standby).get("R1", 0.0) > had, "and fuses R1")
        assert leads(lost) == 1.0, "an ego that is cut off goes on with its own robot"
    finally:
        moved.cut(lost, whole=True)
    await_(lambda: leads(standby) == 0.0, "R3's ego decides for all again", START_S)
    had = received(lost)["R1"]
    await_(lambda: received(lost)["R1"] > had, "and fuses R1 again", START_S)


def test_robots_go_on_without_the_sites_node(moved: Site, manager: Node) -> None:
    ego = moved.nodes[2]
    moved.cut(manager)
    try:

        def alone() -> bool:
            had = received(ego)["R1"]
            time.sleep(2.0)
            return received(ego)["R1"] == had

        await_(alone, "nothing comes from the site's robot any more", CUT_S)
        had = received(ego)["R2"]
        await_(lambda: received(ego)["R2"] > had, "R3's ego goes on with R2")
    finally:
        moved.cut(manager, whole=True)
    had = received(ego)["R1"]
    await_(lambda: received(ego)["R1"] > had, "R1 is fused again", START_S)


def test_without_a_registry_what_is_missing_is_told_and_what_is_there_goes_on(
    moved: Site, manager: Node, cli: Cli
) -> None:
    ego = moved.nodes[2]
    moved.stop_registry()
    before = running(manager)
    missing = f"{REGISTRY}/coadapt-edge:never"
    done = cli("stack", *MOVED, "--only", "robot-R2", "--image", missing)
    assert done.returncode == 0, done.stderr
    manager.docker("stack", "deploy", "--compose-file", "-", STACK, stdin=done.stdout)

    def told() -> bool:
        said = cli("stack", *MOVED, "--check").stderr
        return "robot-R2 does not run on n2: " in said and "coadapt-edge:never" in said

    await_(told, "the engine's reason is passed on", CUT_S)
    had = received(ego)["R1"]
    await_(lambda: received(ego)["R1"] > had, "the ego goes on with R1")
    assert running(manager) == before
    had = received(ego)["R2"]
    await_(lambda: received(ego)["R2"] > had, "the engine goes back to what ran", START_S)


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
    assert sorted(volumes) == [
        f"{STACK}_{name}" for name in ("journal", "prometheus", "site", "targets")
    ]
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
