"""What goes wrong around an ego costs frames or participants, never a decision or a journal line.

Real processes on a real router; the bad robots are sessions of this test.
"""

from __future__ import annotations

import random
import secrets
import shutil
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from ego_agent.__main__ import run
from ego_agent.knowledge.journal import CycleRecord, Journal, read_journal
from ego_agent.knowledge.tally import TallyKeeper
from ego_agent.settings import load_settings
from swarm import keyspace, transport, zenoh_config
from swarm.arrays import pack
from swarm.messages import Beacon, Decision, Detections, SceneDescription, encode
from swarm.session import Session
from swarm.zenoh_config import CONTROL_BYTES
from tests.support.ego_swarm import (
    MessageLog,
    Swarm,
    factory,
    hear,
    metrics_of,
    recorded,
    stop,
    swarm_of,
    until,
)
from tests.support.free_ports import free_ports
from worlds.factory.world import FactoryWorld

pytestmark = pytest.mark.slow

EGO, OTHER = "R1", "R2"
EGO_ENV = {"ego": EGO, "comm_range_m": "500", "period_s": "0.25"}


@pytest.fixture
def world(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return factory(tmp_path_factory.getbasetemp() / "scans")


@pytest.fixture
def swarm(world: dict[str, str], tmp_path: Path) -> Iterator[Swarm]:
    with swarm_of(world, tmp_path) as swarm:
        swarm.router()
        yield swarm


@pytest.fixture
def session(swarm: Swarm) -> Session:
    return swarm.session()


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    return tmp_path / "journal.jsonl"


def together(decision: Decision) -> bool:
    return OTHER in decision.participants


def alone(decision: Decision) -> bool:
    return decision.participants == (EGO,)


def assert_unbroken(decisions: MessageLog[Decision]) -> None:
    """A valid decision in every cycle, none left out."""
    cycles = [d.cycle for d in decisions.all]
    assert cycles == list(range(cycles[0], cycles[0] + len(cycles)))
    assert all(d.valid and d.participants[0] == EGO for d in decisions.all)


def test_a_robot_killed_in_mid_cycle_is_missing_for_one_cycle_and_then_out(
    swarm: Swarm, session: Session, journal: Path
) -> None:
    decisions, frames = swarm.decisions(session, EGO), swarm.detections(session, EGO)
    robot = swarm.robot(OTHER)
    ego = swarm.ego(**EGO_ENV, journal=str(journal))
    frames.until(lambda d: OTHER in d.participants)
    robot.send_signal(signal.SIGKILL)
    decisions.skip()
    decisions.until(alone)
    decisions.until(alone)
    swarm.robot(OTHER)
    decisions.until(together)
    frames.until(lambda d: OTHER in d.participants)
    assert stop(ego) == 0
    assert_unbroken(decisions)
    assert [r.cycle for r in read_journal(journal)][-1] == decisions.all[-1].cycle


def test_a_full_log_disk_costs_no_decision_and_no_line(
    swarm: Swarm, session: Session, journal: Path
) -> None:
    decisions = swarm.decisions(session, EGO)
    swarm.robot(OTHER)
    full = Path("/dev/full")
    ego = swarm.start("ego_agent", logs=full, **EGO_ENV, journal=str(journal))
    decisions.until(together)
    decisions.until(lambda d: d.cycle >= 5)
    assert stop(ego) == 0
    assert_unbroken(decisions)
    assert [r.cycle for r in read_journal(journal)][-1] == decisions.all[-1].cycle


def test_a_router_restart_leaves_the_ego_deciding_alone_and_then_together_again(
    swarm: Swarm, session: Session, journal: Path
) -> None:
    decisions = swarm.decisions(session, EGO)
    swarm.robot(OTHER)
    ego = swarm.ego(**EGO_ENV, journal=str(journal))
    decisions.until(together)
    router = swarm.processes[0]
    router.kill()
    router.wait()
    last = decisions.all[-1].cycle

    def alone_and_away() -> bool:
        away = (r for r in read_journal(journal) if not r.published and r.cycle > last)
        return any(r.decision.participants == (EGO,) for r in away)

    until(alone_and_away, "decisions without a router")
    swarm.router()
    decisions.skip()
    decisions.until(together)
    assert stop(ego) == 0
    records = list(read_journal(journal))
    assert [r.cycle for r in records] == list(range(1, len(records) + 1))
    assert all(r.decision.valid for r in records)


def test_without_a_router_the_ego_runs_alone_and_joins_when_it_comes(
    world: dict[str, str], tmp_path: Path, journal: Path
) -> None:
    with swarm_of(world, tmp_path) as swarm:
        ego = swarm.ego(**EGO_ENV, journal=str(journal))
        until(
            lambda: journal.exists() and any(r.frames.fused > 0 for r in read_journal(journal)),
            "frames are fused",
        )
        assert all(r.decision.participants == (EGO,) for r in read_journal(journal))
        swarm.router()
        swarm.robot(OTHER)
        swarm.decisions(swarm.session(), EGO).until(together)
        assert stop(ego) == 0


@pytest.mark.parametrize("offset_s", [30, -30])
def test_a_robot_whose_clock_is_off_takes_part_with_matching_frames(
    swarm: Swarm, session: Session, offset_s: int
) -> None:
    frames = swarm.detections(session, EGO)
    seen: MessageLog[Beacon] = hear(session, keyspace.beacon("test", OTHER), Beacon)
    swarm.robot(OTHER, clock_offset_s=str(offset_s))
    swarm.ego(**EGO_ENV)
    # Whatever is of another moment is not fused but missing, as "skew".
    fused = [frames.until(lambda d: OTHER in d.participants) for _ in range(5)][-1]
    beacon = seen.until(lambda b: b.frame >= fused.frame)
    frames_apart_s = (beacon.frame - fused.frame) / FactoryWorld.rate_hz
    apart_s = (beacon.capture_ns - fused.capture_ns) * 1e-9 - frames_apart_s
    assert apart_s == pytest.approx(offset_s, abs=1e-3)


def test_a_second_process_with_a_robots_id_gets_the_robot_excluded_with_the_reason(
    swarm: Swarm, session: Session, journal: Path
) -> None:
    decisions = swarm.decisions(session, EGO)
    swarm.robot(OTHER)
    swarm.ego(**EGO_ENV, journal=str(journal))
    decisions.until(together)
    impostor = swarm.robot(OTHER)
    decisions.until(alone)
    until(
        lambda: any(
            "two processes" in r.inputs.excluded.get(OTHER, "") for r in read_journal(journal)
        ),
        "the reason is in the journal",
    )
    impostor.kill()
    decisions.skip()
    decisions.until(together)
    assert_unbroken(decisions)


def test_a_second_process_with_the_egos_id_does_not_harm_the_ego(
    swarm: Swarm, session: Session
) -> None:
    decisions = swarm.decisions(session, EGO)
    swarm.robot(OTHER)
    swarm.robot(EGO)
    swarm.robot(EGO)
    swarm.ego(**EGO_ENV)
    decisions.until(together)
    for _ in range(8):
        decisions.until(together)
    assert_unbroken(decisions)


def bad_messages(robot: str) -> list[tuple[str, bytes]]:
    """Bytes that are no message, or no message that may be believed, on a robot's keys."""
    beacon = Beacon(
        robot=robot,
        instance=1,
        seq=1,
        sent_ns=1,
        capture_ns=1,
        frame=1,
        pose=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        velocity=(0.0, 0.0, 0.0),
        range_m=10.0,
        sizes={"early": 10},
    )
    objects = np.full((3, 9), np.nan, np.float32)
    scene = SceneDescription(
        robot=robot,
        instance=1,
        seq=1,
        sent_ns=1,
        capture_ns=1,
        frame=1,
        pose=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        objects=pack(objects),
        visible_m=pack(np.zeros((0, 0), np.float32)),
        ground_points=0,
        elapsed_ms=1.0,
    )
    good = encode(beacon)
    noise = random.Random(1).randbytes
    beacon_key = keyspace.beacon("test", robot)
    scene_key = keyspace.scene("test", robot)
    return [
        (beacon_key, b""),
        (beacon_key, good[:-5]),
        (beacon_key, good.replace(b"early", b"\xff\xfe\xfd\xfc\xfb")),
        (beacon_key, encode(scene)),
        (keyspace.beacon("test", "someone-else"), good),
        (scene_key, encode(scene)),
        (scene_key, noise(200)),
        (scene_key, noise(CONTROL_BYTES["coadapt/*/robot/*/scene/**"])),
        (keyspace.net_state("test"), noise(64)),
        *((beacon_key, noise(64)) for _ in range(50)),
    ]


def test_garbage_and_large_messages_are_counted_and_change_nothing(
    swarm: Swarm, session: Session
) -> None:
    decisions = swarm.decisions(session, EGO)
    swarm.robot(OTHER)
    port = free_ports(1)
    swarm.ego(**EGO_ENV, metrics_port=str(port))
    decisions.until(together)
    bad = transport.open_zenoh(zenoh_config.client_config(swarm.address), timeout_s=10)
    for key, data in bad_messages("bad"):
        # Block, so that none is lost on the way.
        bad.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)
    invalid = 'coadapt_messages_invalid_total{kind="%s"}'
    until(lambda: metrics_of(port).get(invalid % "Beacon", 0) >= 50, "beacons are counted")
    until(lambda: metrics_of(port).get(invalid % "SceneDescription", 0) >= 2, "scenes as well")
    decisions.skip()
    for _ in range(4):
        decisions.until(together)
    assert_unbroken(decisions)
    bad.close()


def test_kill_9_loses_no_completed_cycle_and_the_journal_goes_on(
    swarm: Swarm, session: Session, journal: Path
) -> None:
    decisions = swarm.decisions(session, EGO)
    swarm.robot(OTHER)
    settings = {**EGO_ENV, "period_s": "0.05", "journal": str(journal)}
    for _ in range(3):
        ego = swarm.ego(**settings)
        heard = len(decisions.all)
        decisions.until(lambda _, n=heard: len(decisions.all) > n + 15 + secrets.randbelow(5))  # type: ignore[misc]
        ego.kill()
        ego.wait()
        last = decisions.all[-1].cycle
        written = [r.cycle for r in read_journal(journal)]
        assert written == list(range(1, len(written) + 1))
        # The last decision's cycle was cut off; every one before it had been completed.
        assert written[-1] >= last - 1
        by_cycle = {r.cycle: r for r in read_journal(journal)}
        for decision in decisions.all[heard:]:
            if decision.cycle < last:
                assert by_cycle[decision.cycle].decision.participants == decision.participants


def test_a_robot_that_stands_still_in_the_middle_does_not_hold_up_the_frames(
    swarm: Swarm, session: Session
) -> None:
    frames = swarm.detections(session, EGO)
    robot = swarm.robot(OTHER)
    swarm.ego(**EGO_ENV)
    frames.until(lambda d: OTHER in d.participants)
    robot.send_signal(signal.SIGSTOP)
    try:
        stuck: Detections = frames.until(lambda d: OTHER in d.missing)
        after = [frames.until(lambda d: True) for _ in range(5)]
        assert stuck.participants == (EGO,)
        assert [d.frame for d in after] == sorted({d.frame for d in after})
    finally:
        robot.send_signal(signal.SIGCONT)
    frames.until(lambda d: OTHER in d.participants)


def test_a_stop_while_a_line_is_written_loses_no_frame(
    journal: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopping, write, count = threading.Event(), Journal.commit, TallyKeeper.fused
    fused: list[Any] = []

    def slow_disk(self: Journal, record: CycleRecord) -> list[CycleRecord]:
        before = len(fused)
        if before and not stopping.is_set():
            stopping.set()
            until(lambda: len(fused) > before, "a frame while the line is written")
        return write(self, record)

    def counted(self: TallyKeeper, *about: Any) -> None:
        count(self, *about)
        fused.append(about)

    monkeypatch.setattr(Journal, "commit", slow_disk)
    monkeypatch.setattr(TallyKeeper, "fused", counted)
    environment = {
        "EGO": EGO,
        "PERIOD_S": "0.25",
        "ROUTER": f"tcp/127.0.0.1:{free_ports(1)}",
        "METRICS_PORT": "0",
        "JOURNAL": str(journal),
    }
    for name, value in environment.items():
        monkeypatch.setenv(f"COADAPT_{name}", value)
    run(load_settings(), FactoryWorld(robots=2, rings=16), stopping)
    assert sum(record.frames.fused for record in read_journal(journal)) == len(fused) > 1


def test_own_scans_that_cannot_be_read_leave_a_valid_decision_in_every_cycle(
    opv2v_dir: Path, tmp_path: Path
) -> None:
    damaged = tmp_path / "damaged"
    shutil.copytree(opv2v_dir, damaged)
    for scan in (damaged / "302").glob("*.pcd"):
        scan.write_bytes(scan.read_bytes()[:100])
    with swarm_of(recorded(damaged), tmp_path) as swarm:
        swarm.router()
        swarm.robot("311")
        session = swarm.session()
        decisions, frames = swarm.decisions(session, "302"), swarm.detections(session, "302")
        swarm.ego(**EGO_ENV | {"ego": "302"})
        fused = frames.until(lambda d: "311" in d.participants)
        assert len(fused.labels) > 0
        assert [d.cycle for d in decisions.all] == sorted(d.cycle for d in decisions.all)
        assert all(d.valid and d.participants[0] == "302" for d in decisions.all)
