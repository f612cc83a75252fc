"""A whole swarm in network namespaces, started and seen through the command line."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy.netns import launch
from deploy.observe import Watch
from deploy.paths import journal_path
from deploy.prometheus import Prometheus
from deploy.runtime import ProcessStatus
from deploy.runtimes.netns import NetnsRuntime
from deploy.state import State, need_state
from swarm.errors import DeployError
from tests.support.command_line import Cli, command_line
from tests.support.deploy_support import WAIT_S, await_, supervisor_of
from tests.support.free_ports import free_port

READY_S = 120.0
SWARM = "works"
NAME = ("--swarm", SWARM)
UP = ("up", "--runtime", "netns", "--robots", "3", "--rings", "16", "--link", "55mbit", *NAME)

Totals = dict[tuple[str, str], int]

_refused = launch.why_not()
pytestmark = [
    pytest.mark.skipif(_refused is not None, reason=str(_refused)),
    pytest.mark.skipif(shutil.which("prometheus") is None, reason="prometheus is not installed"),
]


def ports() -> tuple[str, ...]:
    """Options for ports that are free."""
    options = ("--prometheus-port", "--ego-metrics-port", "--qod-port", "--console-port")
    return tuple(word for option in options for word in (option, str(free_port())))


@pytest.fixture(scope="module")
def cli() -> Iterator[Cli]:
    """Runs `coadapt` as a user does."""
    with command_line(timeout_s=READY_S + WAIT_S) as run:
        yield run


@pytest.fixture(scope="module")
def up() -> tuple[str, ...]:
    """The command that starts the swarm."""
    return (*UP, *ports())


@pytest.fixture(scope="module")
def swarm(cli: Cli, up: tuple[str, ...]) -> Iterator[State]:
    """Three robots, alive, and an ego that has decided."""
    done = cli(*up, "--wait", str(READY_S))
    assert done.returncode == 0, done.stderr
    yield need_state(SWARM)
    assert cli("down", *NAME).returncode == 0


def test_every_process_runs_and_decisions_flow(swarm: State, cli: Cli) -> None:
    done = cli("status", "--json", *NAME)
    assert done.returncode == 0, done.stderr
    table = json.loads(done.stdout)
    assert [p["service"] for p in table["processes"]] == [
        *("router", "controller", "robot-R1", "robot-R2", "robot-R3", "ego-R1", "console"),
        "prometheus",
    ]
    assert {p["state"] for p in table["processes"]} == {"running"}
    assert [r["robot"] for r in table["robots"] if r["alive"]] == ["R1", "R2", "R3"]
    assert table["selected"][0] == "R1"
    assert table["valid"]
    with Watch(swarm, timeout_s=WAIT_S) as watch:
        first = await_(lambda: watch.view().cycle, "a decision") or 0
        await_(lambda: (watch.view().cycle or 0) > first, "the next decision")


def test_prometheus_says_that_every_target_is_up(swarm: State, cli: Cli) -> None:
    server = Prometheus(swarm.prometheus_url)
    await_(lambda: {t.health for t in server.targets()} == {"up"}, "every target is up", WAIT_S)
    assert len(server.targets()) == 8
    robots = {s.labels["robot"] for s in server.query('up{role="robot"}')}
    assert robots == {"R1", "R2", "R3"}

    def shown() -> str:
        done = cli("metrics", *NAME)
        assert done.returncode == 0, done.stderr
        return done.stdout

    await_(lambda: "8 of 8 up" in shown(), "the command line says so, too")


@pytest.mark.stumble(
    "`already runs with another ...` tells no values", command="make up ARGS='--period 5'  # twice"
)
def test_the_second_up_finds_the_swarm_running(swarm: State, cli: Cli, up: tuple[str, ...]) -> None:
    again = cli(*up)
    assert again.returncode == 0, again.stderr
    assert "runs already" in again.stderr
    other = cli(*up, "--period", "5")
    assert other.returncode == 1
    said = "already runs with period_s 1.0 (wanted: 5.0); run `make down SWARM=works` first"
    assert said in other.stderr
    listed = json.loads(cli("list", "--json").stdout)["swarms"]
    assert [(row["swarm"], row["state"]) for row in listed] == [(SWARM, "8 processes run")]


def test_a_killed_robot_is_started_again_and_decisions_stay_valid(swarm: State) -> None:
    runtime = NetnsRuntime()
    with Watch(swarm, timeout_s=WAIT_S) as watch:
        await_(lambda: watch.alive() == {"R1", "R2", "R3"}, "all robots are alive")
        first = await_(lambda: watch.view().cycle, "a decision") or 0
        seen: dict[int, bool] = {}

        def newest() -> int:
            view = watch.view()
            if view.cycle is not None and view.valid is not None:
                seen[view.cycle] = view.valid
            return max(seen, default=0)

        runtime.kill(SWARM, "robot-R2", signal.SIGKILL)
        await_(lambda: newest() and "R2" not in watch.alive(), "R2 is gone")
        await_(lambda: newest() and "R2" in watch.alive(), "R2 is back")
        await_(lambda: newest() >= first + 2, "two more decisions")
        assert len(seen) >= 2
        assert all(seen.values())
    robot = _status(runtime, "robot-R2")
    assert (robot.state, robot.restarts) == ("running", 1)


def test_after_a_router_crash_the_swarm_finds_together_again(swarm: State) -> None:
    runtime = NetnsRuntime()
    runtime.kill(SWARM, "router", signal.SIGKILL)
    await_(lambda: _status(runtime, "router").restarts == 1, "the router is started again")
    await_(lambda: _status(runtime, "router").state == "running", "the router runs")
    with Watch(swarm, timeout_s=WAIT_S) as watch:
        await_(lambda: watch.alive() == {"R1", "R2", "R3"}, "all robots are alive")
        await_(lambda: len(watch.view().selected or ()) > 1, "a decision with other robots")
    assert _status(runtime, "ego-R1").restarts == 0


def _status(runtime: NetnsRuntime, service: str) -> ProcessStatus:
    return next(p for p in runtime.status(SWARM) if p.service == service)


def test_an_unknown_service_is_named(swarm: State) -> None:
    runtime = NetnsRuntime()
    with pytest.raises(DeployError, match="no such process; there are router, controller, robot"):
        runtime.kill(SWARM, "robot-R9", signal.SIGKILL)
    with pytest.raises(DeployError, match="no process 'robot-R9'; there are router"):
        runtime.logs(SWARM, "robot-R9", False)


def test_logs_show_one_event_a_line(swarm: State, cli: Cli) -> None:
    done = cli("logs", "router", *NAME)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[0])["event"] == "router_up"


def test_the_cell_to_the_ego_is_shaped_by_traffic_class(swarm: State) -> None:
    user = [] if os.getuid() == 0 else ["--user", "--preserve-credentials"]
    enter = ["nsenter", "--target", str(supervisor_of(swarm.spec)), "--net", *user]
    shown = subprocess.run(
        [*enter, "tc", "-s", "class", "show", "dev", "link1"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert shown.count("ceil 55Mbit") == 5, "the whole, the classes, bare acknowledgements"
    sent = {
        number: int(size)
        for number, size in re.findall(r"class htb 1:(\d+).*?\n Sent (\d+) bytes", shown)
    }
    # Beacons go to the ego as control traffic, whatever it has decided.
    assert sent["10"] > 0


def _received(server: Prometheus) -> Totals:
    return {
        (sample.labels["robot"], sample.labels["algorithm"]): round(sample.value)
        for sample in server.query("coadapt_ego_received_bytes_total > 0")
    }


def _totals_after_each_cycle(journal: Path) -> list[Totals]:
    totals: Totals = {}
    history = []
    for line in journal.read_text().splitlines():
        for robot, by_algorithm in json.loads(line)["bytes"].items():
            for algorithm, count in by_algorithm.items():
                key = (robot, algorithm)
                totals = totals | {key: totals.get(key, 0) + count}
        history.append(totals)
    return history


def test_recorded_vehicles_send_the_bytes_that_journal_and_prometheus_count(
    cli: Cli, opv2v_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(opv2v_dir, tmp_path / "opv2v-sample" / opv2v_dir.name)
    monkeypatch.setenv("COADAPT_DATA", str(tmp_path))
    name = ("--swarm", "recorded")
    world = ("--world", "opv2v", "--policy", "static-early")
    done = cli("up", "--runtime", "netns", *world, *ports(), "--wait", str(READY_S), *name)
    try:
        assert done.returncode == 0, done.stderr
        state = need_state("recorded")
        assert state.spec.ego == state.spec.robots[0]
        other = state.spec.robots[1]
        server = Prometheus(state.prometheus_url)
        journal = Path(journal_path(state.spec, state.spec.var_dir))

        def agree() -> bool:
            received = _received(server)
            # A scrape may lie some cycles behind the journal, never between two of its lines.
            return received.get((other, "early"), 0) > 0 and received in _totals_after_each_cycle(
                journal
            )

        await_(agree, "Prometheus' bytes are the journal's")
    finally:
        assert cli("down", *name).returncode == 0
