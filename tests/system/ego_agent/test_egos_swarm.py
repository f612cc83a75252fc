"""A swarm in which several robots decide, in network namespaces, as its operator meets it."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from deploy.netns import launch
from deploy.observe import Watch
from deploy.runtimes.netns import NetnsRuntime
from deploy.state import State, need_state, seen_by
from swarm import keyspace
from swarm.messages import Observation
from swarm.session import Session
from tests.support.command_line import answering, command_line
from tests.support.deploy_support import WAIT_S, await_
from tests.support.free_ports import free_port

READY_S = 150.0
SWARM = "egos"
NAME = ("--swarm", SWARM)
EGOS = ("R1", "R3")
PORTS = ("--ego-metrics-port", "--qod-port")

Cli = Callable[..., Any]

_refused = launch.why_not()
pytestmark = pytest.mark.skipif(_refused is not None, reason=str(_refused))


@pytest.fixture(scope="module")
def cli() -> Iterator[Cli]:
    """Runs `coadapt` in this swarm; gives the object that it prints with `--json`."""
    slow = {"COADAPT_FUSION_RATE_HZ": "2", "COADAPT_DEADLINE_S": "0.45"}
    with command_line(*NAME, timeout_s=READY_S + WAIT_S, **slow) as typed:
        yield answering(typed)


@pytest.fixture(scope="module")
def swarm(cli: Cli) -> Iterator[State]:
    """Three robots, of which two decide in one cell."""
    ports = (word for option in PORTS for word in (option, str(free_port())))
    said = cli(
        *("up", "--runtime", "netns", "--robots", "3", "--rings", "16", "--link", "20mbit"),
        *("--cell", "shared", "--egos", ",".join(EGOS), "--policy", "static-early"),
        *("--no-console", "--no-prometheus", "--wait", str(READY_S), *ports),
    )
    assert "egos        R1, R3 decide each for itself" in said
    yield need_state(SWARM)
    cli("down")


def test_each_ego_decides_for_itself_and_is_steered_by_itself(swarm: State, cli: Cli) -> None:
    table = await_(
        lambda: (found := cli("status", "--json"))["egos"][1]["selected"] and found,
        "both egos are heard",
    )
    assert table is not None
    assert [(one["ego"], one["selected"][0]) for one in table["egos"]] == [
        ("R1", "R1"),
        ("R3", "R3"),
    ]
    (reply,) = cli("steer", "--ego", "R3", "--q-min", "0.25", "--json")
    assert (reply["ego"], reply["q_min"]) == ("R3", 0.25)
    (reply,) = cli("steer", "--json")
    assert (reply["ego"], reply["q_min"] == 0.25) == ("R1", False)
    assert "ego R3" in cli("status", "--ego", "R3").splitlines()[0]


def test_the_egos_have_their_parts_of_one_cell(swarm: State) -> None:
    for ego in EGOS:
        with Watch(seen_by(swarm, ego), timeout_s=WAIT_S) as watch:
            cell = await_(watch.cell, f"the link towards {ego} is told")
            assert cell is not None
            assert set(cell.grants) == set(EGOS)
            assert sum(cell.grants.values()) == pytest.approx(20e6, rel=0.01)
            assert cell.capacity_bps < 20e6
            # What the others leave unused for a moment is everybody's.
            assert cell.classes["fusion"].ceil_bps == pytest.approx(20e6, rel=0.01)


def test_a_robot_that_both_want_publishes_once_until_one_is_left(swarm: State) -> None:
    published: list[Observation] = []
    with Session(swarm.router, SWARM, timeout_s=WAIT_S) as session:
        key = keyspace.shared(SWARM, "R2", keyspace.ANY)
        session.subscribe(key, Observation, published.append)
        await_(lambda: len(published) >= 5, "R2 publishes for both")
        frames = [one.frame for one in published]
        assert len(frames) == len(set(frames))
        with Watch(seen_by(swarm, "R3"), timeout_s=WAIT_S) as watch:

            def fuses() -> bool:
                row = next(one for one in watch.view().robots if one.robot == "R2")
                return row.bytes_per_s > 0.0

            await_(fuses, "R3 fuses what is published")
            # The other ego stands still: R3 goes on, and is answered by itself after a while.
            NetnsRuntime().kill(SWARM, "ego-R1", signal.SIGSTOP)
            seen = -1

            def quiet() -> bool:
                nonlocal seen
                before, seen = seen, len(published)
                watch.wait(1.5)
                return before == seen == len(published)

            await_(quiet, "R2 publishes no more")
            await_(fuses, "R3 is answered")
            NetnsRuntime().kill(SWARM, "ego-R1", signal.SIGCONT)
