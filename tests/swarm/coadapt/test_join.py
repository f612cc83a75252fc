"""`coadapt join` on a real swarm: a robot takes part, and both sides say what does not fit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from robot_agent.__main__ import MOVED
from robot_agent.fit import MOVED_WORDS
from swarm import keyspace
from swarm.messages import SCHEMA_VERSION, Beacon, Decision, NetDemand
from swarm.version import DISTRIBUTION, installed_version
from tests.support.ego_swarm import (
    TIMEOUT_S,
    MessageLog,
    Swarm,
    factory,
    hear,
    stop,
    swarm_of,
    until,
)

EPOCH = "1700000000000000000"


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scans")


@pytest.fixture
def swarm(scans: Path, tmp_path: Path) -> Iterator[Swarm]:
    """A router and an ego of R1 on a floor of three."""
    world = factory(scans, robots=3) | {"COADAPT_EPOCH_NS": EPOCH}
    with swarm_of(world, tmp_path) as swarm:
        swarm.router()
        swarm.ego(ego="R1", period_s="0.5")
        yield swarm


class Joined:
    """`coadapt join` as it is typed, with nothing but what is typed."""

    def __init__(
        self, swarm: Swarm, *options: str, packages: Path | None = None, **settings: str
    ) -> None:
        """`packages`: a folder in which Python looks for packages first."""
        self.log = swarm.directory / f"join-{len(swarm.processes)}.log"
        kept = {k: v for k, v in os.environ.items() if not k.startswith("COADAPT_")}
        if packages is not None:
            kept["PYTHONPATH"] = os.pathsep.join([str(packages), kept.get("PYTHONPATH", "")])
        address = f"tcp/127.0.0.1:{swarm.port}"
        usual = ["--swarm", "test", "--rings", "16", "--metrics", "127.0.0.1:0"]
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "coadapt.main", "join", address, *usual, *options],
                env=kept | {f"COADAPT_{k}": v for k, v in settings.items()},
                stdin=subprocess.DEVNULL,
                stderr=log,
            )
        swarm.processes.append(self.process)

    def lines(self, event: str) -> list[dict[str, Any]]:
        """What it has logged of a kind."""
        found = []
        for line in self.log.read_text(errors="replace").splitlines():
            if line.startswith("{") and (entry := json.loads(line))["event"] == event:
                found.append(entry)
        return found

    def says(self, words: str, event: str = "ego_says") -> None:
        until(
            lambda: any(words in line.get("why", "") for line in self.lines(event)),
            f"{event} with {words!r}; it has said {self.log.read_text()[-2000:]}",
        )


@pytest.fixture
def decisions(swarm: Swarm) -> MessageLog[Decision]:
    return swarm.decisions(swarm.session(), "R1")


def test_a_robot_that_joins_lives_where_the_ego_does_and_is_chosen(
    swarm: Swarm, decisions: MessageLog[Decision]
) -> None:
    joined = Joined(swarm, "--robot", "R2")
    decisions.until(lambda d: "R2" in d.participants)
    assert not joined.lines("ego_says")
    assert stop(joined.process) == 0


def test_a_robot_of_another_world_is_left_out_and_both_say_why(
    swarm: Swarm, decisions: MessageLog[Decision]
) -> None:
    joined = Joined(swarm, "--robot", "R2", "--seed", "2")
    why = "it lives in another world: seed 2 (the ego's: 1)"
    decision = decisions.until(lambda d: d.excluded.get("R2") == why)
    assert "R2" not in decision.participants
    joined.says(f"R2: {why}")
    # It was typed: it is meant, however often the ego says it.
    decisions.until(lambda d: d.cycle > decision.cycle + 2 * MOVED_WORDS)
    assert joined.process.poll() is None


@pytest.mark.slow
def test_a_clock_that_is_off_is_told_and_the_robot_is_chosen_all_the_same(
    swarm: Swarm, decisions: MessageLog[Decision]
) -> None:
    joined = Joined(swarm, "--robot", "R2", CLOCK_OFFSET_S="5")
    told = "its clock is 5.0 s ahead of the ego's (frames still fit)"
    decisions.until(lambda d: "R2" in d.participants and d.remarks.get("R2") == told)
    joined.says(f"R2: {told}")


@pytest.mark.slow
def test_another_version_of_the_package_is_told_and_the_robot_is_chosen_all_the_same(
    swarm: Swarm, decisions: MessageLog[Decision], tmp_path: Path
) -> None:
    about = tmp_path / "packages" / f"{DISTRIBUTION.replace('-', '_')}-9.9.dist-info" / "METADATA"
    about.parent.mkdir(parents=True)
    about.write_text(f"Metadata-Version: 2.1\nName: {DISTRIBUTION}\nVersion: 9.9\n")
    joined = Joined(swarm, "--robot", "R2", packages=tmp_path / "packages")
    told = f"it runs version 9.9, the ego {installed_version()}"
    decisions.until(lambda d: "R2" in d.participants and d.remarks.get("R2") == told)
    joined.says(f"R2: {told}")


def test_a_robot_of_another_version_of_the_messages_is_left_out_and_the_others_go_on(
    swarm: Swarm, decisions: MessageLog[Decision]
) -> None:
    joined = Joined(swarm, "--robot", "R2")
    session = swarm.session()
    demands = hear(session, keyspace.net_demand("test"), NetDemand)
    beacon = hear(session, keyspace.beacon("test", "R2"), Beacon).until(lambda _: True)
    newer = msgspec.structs.replace(beacon, robot="R3", v=SCHEMA_VERSION + 1)
    why = (
        f"what it says cannot be read: Beacon of version {SCHEMA_VERSION + 1} of the messages, and "
        f"this program speaks version {SCHEMA_VERSION}: install one version of the package on both"
    )
    session.declare_alive("R3")

    def left_out() -> bool:
        session.put(keyspace.beacon("test", "R3"), newer)
        return any(decision.excluded.get("R3") == why for decision in decisions.all)

    until(left_out, f"R3 is left out because {why}")
    decisions.until(lambda d: d.excluded.get("R3") == why and "R2" in d.participants)
    demands.until(lambda d: d.told == {"R3": why})
    assert not joined.lines("ego_says")


@pytest.mark.slow
def test_of_two_robots_with_one_id_both_are_told(
    swarm: Swarm, decisions: MessageLog[Decision]
) -> None:
    joined = [Joined(swarm, "--robot", "R2") for _ in range(2)]
    decisions.until(lambda d: d.excluded.get("R2") == "two processes use its id")
    for one in joined:
        one.says("R2: two processes use its id")


@pytest.mark.slow
def test_a_robot_whose_ego_was_started_anew_elsewhere_ends_to_be_started_again(
    swarm: Swarm, decisions: MessageLog[Decision]
) -> None:
    joined = Joined(swarm, "--robot", "R2")
    decisions.until(lambda d: "R2" in d.participants)
    stop(swarm.processes[1])
    swarm.ego(ego="R1", period_s="0.5", epoch_ns="1700000900000000000")
    assert joined.process.wait(TIMEOUT_S) == MOVED
    assert "its time runs 900.0 s ahead of the ego's; ended to be started again" in (
        joined.log.read_text()
    )


def test_a_robot_waits_for_its_router_and_says_what_is_wrong(swarm: Swarm) -> None:
    stop(swarm.processes[0])
    joined = Joined(swarm, "--robot", "R2")
    joined.says(f"127.0.0.1 is there, but nothing listens on its port {swarm.port}", "router_away")
    (line, *_) = joined.lines("router_away")
    assert line["router"] == swarm.address
    swarm.router()
    decisions = swarm.decisions(swarm.session(), "R1")
    decisions.until(lambda d: "R2" in d.participants)


@pytest.mark.slow
def test_a_robot_in_the_wrong_swarm_hears_nobody_and_says_so(swarm: Swarm) -> None:
    joined = Joined(swarm, "--robot", "R2", "--swarm", "tset")
    joined.says("no ego of swarm 'tset' is heard at tcp/127.0.0.1", "no_ego")
    assert stop(joined.process) == 0


@pytest.mark.slow
def test_a_robot_that_the_world_has_no_room_for_is_told_so(swarm: Swarm) -> None:
    joined = Joined(swarm, "--robot", "R7")
    assert joined.process.wait(TIMEOUT_S) == 1
    assert "--robot R7 is not one of R1 to R3" in joined.log.read_text()
