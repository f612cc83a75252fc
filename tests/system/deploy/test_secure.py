"""A secure swarm in network namespaces, seen through the command line."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from deploy.netns import launch
from deploy.paths import KEYSTORE, journal_path, net_journal_path
from deploy.prometheus import Prometheus
from deploy.state import State, need_state
from ego_agent.knowledge.journal import read_journal
from swarm import keyspace
from swarm.errors import TransportError
from swarm.messages import EgoSteered, EgoSteering, EgoWish, Intent
from swarm.session import Session
from swarm.trust.identity import ISSUED
from tests.support.command_line import Cli, command_line
from tests.support.deploy_support import WAIT_S, await_
from tests.support.free_ports import free_port, free_ports
from tests.support.link_support import must

READY_S = 120.0
SWARM = "trusty"
NAME = ("--swarm", SWARM)
UNANSWERED_S = 5.0
"""A request that the router lets through is answered in less."""
LIFE_S = 60
"""Renewed when a third of it is left."""

HERE, THERE = ("10.91.0.1", "10.91.0.2") if os.geteuid() == 0 else ("127.0.0.1", "")
"""Of this machine, and of another one, where there may be one."""

_refused = launch.why_not()
pytestmark = [
    pytest.mark.skipif(_refused is not None, reason=str(_refused)),
    pytest.mark.skipif(shutil.which("prometheus") is None, reason="prometheus is not installed"),
]


@pytest.fixture(scope="module")
def cli() -> Iterator[Cli]:
    """Runs `coadapt` as a user does, in this swarm."""
    life = {"COADAPT_CERTIFICATE_LIFE_S": str(LIFE_S)}
    with command_line(*NAME, timeout_s=READY_S + WAIT_S, **life) as run:
        yield run


@pytest.fixture(scope="module")
def machine() -> Iterator[str]:
    """Another machine, a network namespace with a cable to this one: its name; empty where this
    user may make none."""
    if not THERE:
        yield ""
        return
    name, cable = f"t{os.getpid()}-there", f"t{os.getpid()}-c"
    with ExitStack() as stack:
        must("ip", "netns", "add", name)
        stack.callback(must, "ip", "netns", "del", name)
        must("ip", "link", "add", cable, "type", "veth", "peer", "name", "eth0", "netns", name)
        must("ip", "addr", "add", f"{HERE}/24", "dev", cable)
        must("ip", "link", "set", cable, "up")
        must("ip", "-n", name, "addr", "add", f"{THERE}/24", "dev", "eth0")
        must("ip", "-n", name, "link", "set", "eth0", "up")
        must("ip", "-n", name, "link", "set", "lo", "up")
        yield name


@pytest.fixture(scope="module")
def up(machine: str) -> tuple[str, ...]:
    options = ("--prometheus-port", "--ego-metrics-port", "--qod-port", "--console-port")
    ports = tuple(word for option in options for word in (option, str(free_port())))
    robots: tuple[str, ...] = ("--runtime", "netns", "--robots", "3", "--rings", "16")
    # Others reach it at an address of this machine, and the floor has room for one of them.
    robots += ("--listen", HERE, "--router-port", str(free_ports(3)), "--world-robots", "4")
    return ("up", "--secure", "--metrics-tls", *robots, *ports, "--wait", str(READY_S))


@pytest.fixture(scope="module")
def swarm(cli: Cli, up: tuple[str, ...]) -> Iterator[State]:
    done = cli(*up)
    assert done.returncode == 0, done.stderr
    yield need_state(SWARM)
    assert cli("down").returncode == 0


def status(cli: Cli) -> dict[str, Any]:
    """What `coadapt status` shows; where the router opens anew just now, a moment later."""

    def shown() -> dict[str, Any]:
        done = cli("status", "--json")
        table: dict[str, Any] = json.loads(done.stdout) if done.returncode == 0 else {}
        return table

    return await_(shown, "a status")


def all_take_part(cli: Cli) -> bool:
    table = status(cli)
    return (
        all(robot["alive"] for robot in table["robots"])
        and set(table["selected"]) == {"R1", "R2", "R3"}
        and table["bytes_per_s"] > 0
    )


def test_robots_are_fused_and_status_says_who_is_trusted(swarm: State, cli: Cli) -> None:
    await_(lambda: all_take_part(cli), "all robots are fused")
    names = {one["name"] for one in status(cli)["trust"]}
    assert names == {
        *("R1", "R2", "R3", "ego-R1", "router", "authority", "controller", "console"),
        "operator-local",
    }
    text = cli("status").stdout
    assert (
        "trust      R1, R2, R3, authority, console, controller, ego-R1, operator-local, router"
        in text
    )


def test_who_acts_stands_in_the_journal_as_the_router_let_them_in(swarm: State, cli: Cli) -> None:
    # The router opens anew for its certificate now and then.
    shape = ("net", "shape", "--rate", "40mbit", "--robot", "R2")
    await_(lambda: cli(*shape).returncode == 0, "R2's link is shaped")
    await_(lambda: cli("steer", "--stop", "R3").returncode == 0, "R3 is off duty")
    journal = Path(net_journal_path(swarm.spec, swarm.spec.var_dir))

    def told() -> bool:
        return "asked for by operator-local" in journal.read_text()

    await_(told, "the action is in the controller's journal")
    on_duty = "R3 is on duty, by operator-local since"
    await_(lambda: on_duty in cli("steer", "--start", "R3").stdout, "R3 is on duty")


def identity_of(swarm: State, cli: Cli, name: str) -> Path:
    assert cli("certs", "issue", name).returncode == 0
    return Path(swarm.spec.var_dir, KEYSTORE, ISSUED, name)


def test_who_has_a_certificate_operates_it_without_its_run_directory(
    swarm: State, cli: Cli
) -> None:
    place = f"tls/{HERE}:{swarm.spec.router_port}"
    router = ("--router", f"{place}#identity={identity_of(swarm, cli, 'operator-ann')}")

    def seen() -> dict[str, Any]:
        done = cli("status", "--json", *router)
        table: dict[str, Any] = json.loads(done.stdout) if done.returncode == 0 else {}
        return table if table.get("selected") else {}

    table = await_(seen, "a status through the router")
    assert (table["ego"], table["runtime"]) == ("R1", "elsewhere")
    assert {row["robot"] for row in table["robots"]} >= {"R1", "R2", "R3"}
    assert (table["processes"], table["trust"]) == ([], None)
    await_(lambda: "R1 decides by" in cli("steer", *router).stdout, "the ego is asked")
    await_(lambda: cli("net", "show", *router).returncode == 0, "the controller is asked")


def test_a_wish_needs_the_certificate_of_an_operator(swarm: State, cli: Cli) -> None:
    await_(lambda: all_take_part(cli), "all robots are fused")
    wish = ("wish", "--intent", '{"exclude": ["R3"]}', "--apply", "--router")

    def router_for(name: str) -> str:
        place = f"tls/{HERE}:{swarm.spec.router_port}"
        return f"{place}#identity={identity_of(swarm, cli, name)}"

    def told_so() -> bool:
        done = cli(*wish, router_for("reader-bob"))
        return done.returncode == 1 and "reader-bob may only look at swarm" in done.stderr

    await_(told_so, "who may only look is told so")
    # Nor does the router let such a request through, whoever makes it.
    asked = EgoSteering(wish=EgoWish(), act="confirm", intent=Intent(exclude=("R3",)))
    key = keyspace.ego_steering(SWARM, "R1")
    with Session(router_for("reader-bob"), SWARM, timeout_s=WAIT_S) as reader:
        answer = reader.ask(key, asked, EgoSteered, timeout_s=UNANSWERED_S)
        assert type(answer.exception()) is TransportError
    none = "R1 obeys no wish\n"
    await_(lambda: cli("wish", "--list").stdout == none, "nothing is in force")

    def obeyed() -> str:
        done = cli(*wish, router_for("operator-ann"))
        found = re.search(r"R1 obeys wish (\d+) of operator-ann since", done.stdout)
        return found[1] if found else ""

    number = await_(obeyed, "an operator's wish is obeyed")
    shown = f"wish       {number} of operator-ann since"
    await_(lambda: shown in cli("status").stdout, "it is shown")
    await_(lambda: "R3" not in (status(cli)["selected"] or ("R3",)), "R3 is left out")
    # The router opens anew for its certificate now and then: one may have been heard twice.
    for one in range(1, int(number) + 1):
        cli("wish", "--withdraw", str(one), "--router", router_for("operator-ann"))
    await_(lambda: cli("wish", "--list").stdout == none, "it is withdrawn")
    await_(lambda: all_take_part(cli), "R3 takes part again")


def test_a_robot_that_joins_from_another_machine_is_chosen_until_it_leaves(
    swarm: State, cli: Cli, machine: str
) -> None:
    if not machine:
        pytest.skip("only root makes a network namespace with a cable to this machine")
    folder = identity_of(swarm, cli, "R4")
    place = f"tls/{HERE}:{swarm.spec.router_port}"
    options = ("--robot", "R4", "--cert", str(folder), "--rings", "16", "--metrics", "127.0.0.1:0")
    there = ("ip", "netns", "exec", machine)
    with subprocess.Popen(
        [*there, sys.executable, "-m", "coadapt.main", "join", place, *options],
        stderr=subprocess.PIPE,
        text=True,
    ) as joined:
        try:
            assert joined.stderr is not None
            said = f"robot R4 joins swarm {SWARM!r} at {place}; Ctrl-C ends it\n"
            assert joined.stderr.readline() == said
            await_(lambda: "R4" in (status(cli)["selected"] or ()), "the ego chooses R4")
            joined.terminate()
            assert joined.wait(WAIT_S) == 0
        finally:
            joined.kill()
    await_(lambda: "R4" not in (status(cli)["selected"] or ("R4",)), "R4 is out")


def ends(cli: Cli) -> dict[str, str]:
    done = cli("certs", "list", "--json")
    assert done.returncode == 0, done.stderr
    return {one["name"]: one["end"] for one in json.loads(done.stdout)["certificates"]}


def test_certificates_are_renewed_and_no_cycle_is_lost(swarm: State, cli: Cli) -> None:
    before = ends(cli)
    await_(lambda: all(ends(cli)[name] > end for name, end in before.items()), "all are renewed")
    await_(lambda: all_take_part(cli), "all robots are fused again")
    journal = Path(journal_path(swarm.spec, swarm.spec.var_dir))
    cycles = [record.cycle for record in read_journal(journal)]
    assert cycles == list(range(cycles[0], cycles[0] + len(cycles)))
    assert {process["restarts"] for process in status(cli)["processes"]} == {0}


def test_metrics_are_read_over_tls_while_certificates_are_renewed(swarm: State) -> None:
    assert swarm.ego_metrics_url.startswith("https://")
    prometheus = Prometheus(swarm.prometheus_url)
    wanted = {"router", "controller", "console", "authority", "prometheus", "ego-R1"}
    wanted |= {f"robot-R{number}" for number in (1, 2, 3)}

    def up() -> set[str]:
        return {target.instance for target in prometheus.targets() if target.health == "up"}

    await_(lambda: up() >= wanted, "all of them are read")
    # Those that were started with the swarm are read once, though they tell where they are, too.
    known = [target.instance for target in prometheus.targets()]
    assert all(known.count(instance) == 1 for instance in wanted)


def test_prometheus_knows_how_long_certificates_hold(swarm: State) -> None:
    prometheus = Prometheus(swarm.prometheus_url)

    def left() -> dict[str, float]:
        found = prometheus.query("coadapt_certificate_seconds")
        return {sample.labels["name"]: sample.value for sample in found}

    await_(lambda: {"R3", "router", "ego-R1"} <= set(left()), "certificates are told")
    assert all(0 < seconds <= LIFE_S for seconds in left().values())


def test_the_revoked_take_no_part_and_are_not_started_again(
    swarm: State, cli: Cli, up: tuple[str, ...]
) -> None:
    assert "swarm 'trusty' runs with the authority" in cli("certs", "init", "--again").stderr
    assert cli("certs", "revoke", "R3").returncode == 0

    def without() -> bool:
        table = status(cli)
        return "R3" not in table["selected"] and "R2" in table["selected"]

    await_(without, "R3 is out")
    assert "revoked: R3" in cli("status").stdout
    assert cli("down").returncode == 0
    refused = cli(*up)
    assert refused.returncode == 1
    assert "R3 was revoked" in refused.stderr
    assert "`coadapt certs issue R3 --again` gives it its rights back" in refused.stderr
    assert cli("certs", "issue", "R3", "--again").returncode == 0
    again = cli(*up)
    assert again.returncode == 0, again.stderr
    await_(lambda: all_take_part(cli), "R3 is back")


@pytest.mark.parametrize(
    ("robot", "told"),
    [
        ("console", "is the name of another role in a secure swarm"),
        ("ego-1", "is the name of another role in a secure swarm"),
        ("r" * 30, "is too long for a secure swarm"),
    ],
)
def test_a_robots_name_cannot_be_another_roles(robot: str, told: str) -> None:
    from deploy.spec import make_spec
    from swarm.errors import DeployError

    with pytest.raises(DeployError, match=told):
        make_spec(robots=("R1", robot), secure=True)
