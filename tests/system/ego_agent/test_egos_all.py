"""Every robot of twelve is an ego, in one cell, in network namespaces."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from deploy.netns import launch
from deploy.observe import Watch
from deploy.state import State, need_state, seen_by
from tests.support.command_line import answering, command_line
from tests.support.deploy_support import WAIT_S, await_
from tests.support.free_ports import free_port

READY_S = 240.0
SWARM = "every"
ROBOTS = 12
EVERYBODY = {f"R{number}" for number in range(1, ROBOTS + 1)}

Cli = Callable[..., Any]

_refused = launch.why_not()
pytestmark = pytest.mark.skipif(_refused is not None, reason=str(_refused))


@pytest.fixture(scope="module")
def cli() -> Iterator[Cli]:
    """Runs `coadapt` in this swarm; gives the object that it prints with `--json`."""
    # So that two cores have time for twelve egos and twelve robots.
    slow = {"COADAPT_FUSION_RATE_HZ": "0.5", "COADAPT_DEADLINE_S": "1.5"}
    with command_line("--swarm", SWARM, timeout_s=READY_S + WAIT_S, **slow) as typed:
        yield answering(typed)


@pytest.fixture(scope="module")
def swarm(cli: Cli) -> Iterator[State]:
    cli(
        *("up", "--runtime", "netns", "--robots", str(ROBOTS), "--egos", "all", "--rings", "16"),
        *("--link", "55mbit", "--cell", "shared", "--policy", "coverage", "--no-console"),
        *("--no-prometheus", "--period", "5", "--wait", str(READY_S)),
        *("--ego-metrics-port", str(free_port())),
        *("--qod-port", str(free_port())),
    )
    yield need_state(SWARM)
    cli("down")


@pytest.mark.timeout(600)
def test_all_twelve_decide_and_have_their_parts_of_the_cell(swarm: State, cli: Cli) -> None:
    def decided() -> list[dict[str, Any]] | None:
        rows = cli("status", "--json")["egos"]
        return rows if all(row["selected"] and row["valid"] for row in rows) else None

    rows = await_(decided, "every ego has decided", timeout_s=READY_S)
    assert rows is not None
    assert {row["ego"] for row in rows} == EVERYBODY
    assert all(row["selected"][0] == row["ego"] for row in rows)
    with Watch(seen_by(swarm, "R7"), timeout_s=WAIT_S) as watch:
        cell = await_(watch.cell, "the link towards R7 is told")
        assert cell is not None
        assert set(cell.grants) == EVERYBODY
        assert sum(cell.grants.values()) == pytest.approx(55e6, rel=0.01)
