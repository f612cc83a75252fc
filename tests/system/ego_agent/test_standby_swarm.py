"""A swarm with a standby ego in network namespaces, as its operator meets it."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from deploy.netns import launch
from deploy.observe import Watch
from deploy.prometheus import Prometheus
from deploy.runtimes.netns import NetnsRuntime
from deploy.state import State, need_state
from deploy.view import SwarmView
from tests.support.command_line import answering, command_line
from tests.support.deploy_support import WAIT_S, await_
from tests.support.free_ports import free_port

READY_S = 120.0
SWARM = "standby"
NAME = ("--swarm", SWARM)
PORTS = ("--prometheus-port", "--ego-metrics-port", "--qod-port")

Cli = Callable[..., Any]

_refused = launch.why_not()
pytestmark = [
    pytest.mark.skipif(_refused is not None, reason=str(_refused)),
    pytest.mark.skipif(shutil.which("prometheus") is None, reason="prometheus is not installed"),
]


@pytest.fixture(scope="module")
def cli() -> Iterator[Cli]:
    """Runs `coadapt` in this swarm; gives the object that it prints with `--json`."""
    with command_line(*NAME, timeout_s=READY_S + WAIT_S) as typed:
        yield answering(typed)


@pytest.fixture(scope="module")
def swarm(cli: Cli) -> Iterator[State]:
    """Three robots; R1's ego decides, and R2's stands by."""
    ports = (word for option in PORTS for word in (option, str(free_port())))
    said = cli(
        *("up", "--runtime", "netns", "--robots", "3", "--rings", "16", "--link", "20mbit"),
        *("--ego-standby", "R2", "--no-console", "--wait", str(READY_S), *ports),
    )
    assert "standby     R2 decides while the ego of R1 is away" in said
    yield need_state(SWARM)
    cli("down")


@pytest.fixture
def watch(swarm: State) -> Iterator[Watch]:
    with Watch(swarm, timeout_s=WAIT_S) as watch:
        await_(lambda: view_of(watch, "R1"), "R1 decides")
        yield watch


def view_of(watch: Watch, ego: str) -> SwarmView | None:
    """What the swarm says, where that ego decides with all robots."""
    view = watch.view()
    return view if view.ego == ego and len(view.selected or ()) == 3 else None


def follows(swarm: State) -> bool:
    """Whether the standby knows everybody."""
    found = Prometheus(swarm.prometheus_url).query(
        'sum(coadapt_ego_robot_alive{instance="ego-R2"})'
    )
    return [sample.value for sample in found] == [2.0]


def test_the_cell_towards_the_standby_is_shaped_as_the_egos(swarm: State, cli: Cli) -> None:
    def shaped() -> set[tuple[str, int]]:
        return {(s["robot"], s["rate_bps"]) for s in cli("net", "show", "--json")["shapes"]}

    both = {("R1", 20_000_000), ("R2", 20_000_000)}
    await_(lambda: shaped() == both, "both links are shaped")
    cli("net", "shape", "--rate", "15mbit")
    both = {("R1", 15_000_000), ("R2", 15_000_000)}
    await_(lambda: shaped() == both, "both links are shaped anew")


def test_status_and_steering_follow_the_ego_that_decides(
    swarm: State, cli: Cli, watch: Watch
) -> None:
    await_(lambda: follows(swarm), "the standby follows the swarm")
    assert [r["ego"] for r in cli("steer", "--q-min", "0.5", "--json")] == ["R1", "R2"]

    NetnsRuntime().kill(SWARM, "ego-R1", signal.SIGSTOP)
    view = await_(lambda: view_of(watch, "R2"), "R2 decides")
    assert view is not None
    assert view.stands_in_for == "R1"
    assert view.cell_bps == 15_000_000
    table = cli("status", "--json")
    assert (table["ego"], table["stands_in_for"]) == ("R2", "R1")
    assert "ego R2 IN THE STEAD OF R1" in cli("status")
    (reply,) = cli("steer", "--policy", "static-late", "--json")
    assert (reply["ego"], reply["policy"]) == ("R2", "static-late")

    NetnsRuntime().kill(SWARM, "ego-R1", signal.SIGKILL)
    view = await_(lambda: view_of(watch, "R1"), "R1 decides again")
    assert view is not None
    assert view.stands_in_for is None


def test_a_crash_loop_raises_an_alert(swarm: State) -> None:
    server = Prometheus(swarm.prometheus_url)

    def begun() -> float:
        found = server.query('process_start_time_seconds{instance="controller"}')
        return found[0].value if found else 0.0

    for _ in range(3):
        before = await_(begun, "Prometheus knows when the controller began")
        NetnsRuntime().kill(SWARM, "controller", signal.SIGKILL)
        await_(lambda before=before: begun() > before, "it has begun anew")  # type: ignore[misc]
    alert = ("CrashLoop", "controller is started again and again.")
    await_(lambda: alert in {(a.name, a.summary) for a in server.alerts()}, "the alert fires")
