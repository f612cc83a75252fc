"""Two real egos, one of which stands in for the other: one decides at a time, and one always."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ego_agent.knowledge.journal import read_journal
from swarm.messages import Decision
from tests.support.ego_swarm import Swarm, factory, metrics_of, stop, swarm_of, until
from tests.support.free_ports import free_ports

pytestmark = pytest.mark.slow


class Egos:
    """A swarm of three robots with an ego R1 and the one that stands in for it, R2."""

    def __init__(self, swarm: Swarm) -> None:
        self.swarm = swarm
        self.router = swarm.router()
        swarm.robot("R1", "R2", "R3")
        session = swarm.session()
        self.decisions = {ego: swarm.decisions(session, ego) for ego in ("R1", "R2")}
        self.detections = {ego: swarm.detections(session, ego) for ego in ("R1", "R2")}
        self.port = free_ports(1)
        self.first = self.start_first()
        self.until_decides("R1")
        self.standby = self.start(
            ego="R2", stands_in_for="R1", metrics_port=str(self.port), journal=self.journal("R2")
        )
        # Its picture of who is there comes with the same session as the first one's token.
        until(lambda: self.sees() >= {"R1", "R3"}, "the standby follows the swarm")

    def start(self, **env: str) -> subprocess.Popen[bytes]:
        return self.swarm.ego(comm_range_m="500", period_s="0.5", **env)

    def start_first(self) -> subprocess.Popen[bytes]:
        return self.start(ego="R1", ego_standby="R2", journal=self.journal("R1"))

    def journal(self, ego: str) -> str:
        return str(self.swarm.directory / f"{ego}.jsonl")

    def sees(self) -> set[str]:
        try:
            shown = metrics_of(self.port)
        except OSError:
            return set()
        return {r for r in ("R1", "R3") if shown.get(f'coadapt_ego_robot_alive{{robot="{r}"}}')}

    def until_decides(
        self, ego: str, wanted: Callable[[Decision], bool] = lambda _: True
    ) -> Decision:
        """The next decision of an ego, with everybody, whose frames come, too."""
        for heard in (self.decisions[ego], self.detections[ego]):
            heard.skip()
        decision = self.decisions[ego].until(lambda d: len(d.participants) == 3 and wanted(d))
        self.detections[ego].until(lambda d: d.cycle >= decision.cycle)
        return decision

    def rests(self, ego: str, other: str) -> None:
        """Nothing comes of an ego while another one decides and fuses; of what it had begun at most
        one decision."""
        self.until_decides(other)
        before = len(self.decisions[ego].all), len(self.detections[ego].all)
        for _ in range(6):
            self.until_decides(other)
        after = len(self.decisions[ego].all), len(self.detections[ego].all)
        assert after == before


@pytest.fixture
def egos(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Egos]:
    scans = tmp_path_factory.getbasetemp() / "scans-standby"
    with swarm_of(factory(scans, robots=3), tmp_path) as swarm:
        yield Egos(swarm)


def test_one_ego_decides_whatever_becomes_of_the_other(egos: Egos) -> None:
    egos.rests("R2", "R1")
    assert egos.decisions["R2"].all == []
    assert not Path(egos.journal("R2")).stat().st_size

    egos.first.kill()
    assert egos.until_decides("R2").stands_in_for == "R1"

    egos.first = egos.start_first()
    # It speaks only when it knows everybody.
    assert len(egos.decisions["R1"].until(lambda _: True).participants) == 3
    egos.rests("R2", "R1")

    egos.first.send_signal(signal.SIGSTOP)
    egos.until_decides("R2")
    egos.first.send_signal(signal.SIGCONT)
    egos.until_decides("R1")
    egos.rests("R2", "R1")

    egos.standby.kill()
    egos.until_decides("R1")
    assert stop(egos.first) == 0
    lines = {ego: list(read_journal(Path(egos.journal(ego)))) for ego in ("R1", "R2")}
    for ego, first in (("R1", None), ("R2", "R1")):
        assert {line.decision.stands_in_for for line in lines[ego]} == {first}
        cycles = [line.cycle for line in lines[ego]]
        assert cycles == list(range(1, len(cycles) + 1))


def test_a_router_that_restarts_changes_nothing(egos: Egos) -> None:
    assert stop(egos.router) == 0
    egos.router = egos.swarm.router()
    egos.rests("R2", "R1")
    assert egos.decisions["R2"].all == []


def test_a_standby_that_finds_no_first_ego_leads(egos: Egos) -> None:
    egos.first.kill()
    egos.until_decides("R2")
    egos.standby.kill()
    egos.standby = egos.start(ego="R2", stands_in_for="R1")
    assert egos.until_decides("R2").cycle >= 1
