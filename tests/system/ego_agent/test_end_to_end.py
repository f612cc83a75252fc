"""One ego with its robots on a real router: what it publishes, writes and counts."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from ego_agent.knowledge.journal import byte_totals, read_journal
from ego_agent.settings import load_settings
from swarm.arrays import unpack_finite
from swarm.errors import SettingError
from swarm.messages import Decision
from tests.support.ego_swarm import Swarm, factory, metrics_of, recorded, stop, swarm_of, until
from tests.support.free_ports import free_ports

EGO, OTHER = "R1", "R2"
EGO_ENV = {"ego": EGO, "comm_range_m": "500", "period_s": "0.25"}


@pytest.fixture
def swarm(tmp_path_factory: pytest.TempPathFactory, tmp_path: Path) -> Iterator[Swarm]:
    world = factory(tmp_path_factory.getbasetemp() / "scans")
    with swarm_of(world, tmp_path) as swarm:
        swarm.router()
        yield swarm


def together(decision: Decision) -> bool:
    return OTHER in decision.participants


def test_decisions_frames_journal_and_metrics_tell_the_same_story(
    swarm: Swarm, tmp_path: Path
) -> None:
    session = swarm.session()
    decisions, frames = swarm.decisions(session, EGO), swarm.detections(session, EGO)
    journal, port = tmp_path / "journal.jsonl", free_ports(1)
    swarm.robot(OTHER)
    ego = swarm.ego(**EGO_ENV, journal=str(journal), metrics_port=str(port))
    decisions.until(together)
    for _ in range(12):
        frames.until(lambda d: OTHER in d.participants)

    # Prometheus and the journal agree while both go on: what is scraped was written before.
    def agree() -> bool:
        scraped = received(port)
        written = sum((byte_totals(r) for r in read_journal(journal)), Counter())
        assert scraped <= written
        return scraped == written and scraped.total() > 0

    until(agree, "a scrape with no cycle completed meanwhile")
    assert stop(ego) == 0

    for decision in decisions.all:
        assert decision.valid
        assert decision.participants[0] == EGO
        assert decision.cost_bytes * 8 * decision.rate_hz <= decision.capacity_bps
    for frame in frames.all:
        boxes = unpack_finite(frame.boxes, "boxes", 7)
        assert len(boxes) == len(frame.labels) == frame.scores.shape[0]
        assert set(frame.participants[1:]) == set(frame.bytes)
    records = list(read_journal(journal))
    assert [r.cycle for r in records] == list(range(1, len(records) + 1))
    heard = {d.cycle: d for d in decisions.all}
    for line in records:
        if line.cycle in heard:
            assert line.decision.participants == heard[line.cycle].participants
            assert line.decision.cost_bytes == heard[line.cycle].cost_bytes
    assert records[-1].cycle == decisions.all[-1].cycle
    assert sum(r.frames.fused for r in records) >= len(frames.all)
    of_frames = sum(d.bytes.get(OTHER, 0) for d in frames.all)
    of_journal = sum((byte_totals(r) for r in records), Counter()).total()
    assert of_journal >= of_frames > 0


def received(port: int) -> Counter[tuple[str, str]]:
    """Received bytes by robot and algorithm, as Prometheus would read them."""
    name = "coadapt_ego_received_bytes_total{"
    found: Counter[tuple[str, str]] = Counter()
    for sample, value in metrics_of(port).items():
        if sample.startswith(name):
            labels = dict(part.split("=") for part in sample[len(name) : -1].split(","))
            key = labels["robot"].strip('"'), labels["algorithm"].strip('"')
            found[key] = int(value)
    return found


def test_recorded_vehicles_are_fused_too(opv2v_dir: Path, tmp_path: Path) -> None:
    with swarm_of(recorded(opv2v_dir), tmp_path) as swarm:
        swarm.router()
        swarm.robot("311")
        frames = swarm.detections(swarm.session(), "302")
        swarm.ego(**EGO_ENV | {"ego": "302"})
        fused = frames.until(lambda d: "311" in d.participants)
        assert len(fused.labels) > 0


def test_metrics_go_on_from_the_journal_after_a_restart(swarm: Swarm, tmp_path: Path) -> None:
    journal, port = tmp_path / "journal.jsonl", free_ports(1)
    swarm.robot(OTHER)
    ego = swarm.ego(**EGO_ENV, journal=str(journal))
    frames = swarm.detections(swarm.session(), EGO)
    frames.until(lambda d: OTHER in d.participants)
    assert stop(ego) == 0
    so_far = sum((byte_totals(r) for r in read_journal(journal)), Counter())
    last = [r.cycle for r in read_journal(journal)][-1]
    slow = EGO_ENV | {"period_s": "30"}
    swarm.ego(**slow, journal=str(journal), metrics_port=str(port))
    until(lambda: serves(port), "the metrics are served")
    assert received(port) == so_far
    assert so_far.total() > 0
    assert [r.cycle for r in read_journal(journal)][-1] == last


def serves(port: int) -> bool:
    try:
        return bool(metrics_of(port))
    except OSError:
        return False


def test_a_torn_line_is_set_aside_at_the_start(swarm: Swarm, tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    ego = swarm.ego(**EGO_ENV, journal=str(journal))
    until(lambda: journal.exists() and len(list(read_journal(journal))) >= 2, "two lines")
    ego.kill()
    ego.wait()
    whole = journal.read_bytes()
    journal.write_bytes(whole[:-10])
    complete = len(list(read_journal(journal)))
    swarm.ego(**EGO_ENV, journal=str(journal))
    until(lambda: len(list(read_journal(journal))) > complete, "a new line")
    cycles = [r.cycle for r in read_journal(journal)]
    assert cycles == list(range(1, len(cycles) + 1))
    assert journal.with_name("journal.jsonl.torn").read_bytes().startswith(b'{"v":1')
    assert "journal_torn" in swarm.logs()


def test_a_second_ego_on_the_same_journal_is_told_so(swarm: Swarm, tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    swarm.ego(**EGO_ENV, journal=str(journal))
    until(journal.exists, "the journal is open")
    until(lambda: len(list(read_journal(journal))) >= 1, "one line")
    second = swarm.ego(**EGO_ENV, journal=str(journal))
    assert second.wait(60) == 1
    assert "is being written by another ego" in swarm.logs()


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("POLICY", "genius", "allowed: coverage"),
        ("ALGORITHMS", "magic", "COADAPT_ALGORITHMS = 'magic' holds none"),
        ("PERIOD_S", "0", "COADAPT_PERIOD_S"),
        ("EGO", "R9", "allowed: R1, R2"),
        ("ROUTER", "somewhere", "tcp/HOST:PORT"),
        ("JOURNAL", "/proc/journal.jsonl", "cannot be opened"),
    ],
)
def test_a_wrong_setting_ends_the_process_with_one_clear_line(
    swarm: Swarm, name: str, value: str, told: str
) -> None:
    wrong = {f"COADAPT_{k.upper()}": v for k, v in EGO_ENV.items()} | {f"COADAPT_{name}": value}
    process = subprocess.run(
        [sys.executable, "-m", "ego_agent"],
        env={**swarm.env, **wrong},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert process.returncode == 1
    assert process.stdout == ""
    (line,) = process.stderr.splitlines()
    assert line.startswith("ego_agent: ")
    assert told in line


def test_a_data_directory_that_cannot_be_read_ends_the_process_with_one_clear_line(
    swarm: Swarm, tmp_path: Path
) -> None:
    process = subprocess.run(
        [sys.executable, "-m", "ego_agent"],
        env={**swarm.env, **recorded(tmp_path / "none")},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert process.returncode == 1
    (line,) = process.stderr.splitlines()
    assert str(tmp_path / "none") in line


def test_a_taken_metrics_port_ends_the_process_with_one_clear_line(swarm: Swarm) -> None:
    process = subprocess.run(
        [sys.executable, "-m", "ego_agent"],
        env={**swarm.env, "COADAPT_EGO": EGO, "COADAPT_METRICS_PORT": str(swarm.port)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert process.returncode == 1
    (line,) = process.stderr.splitlines()
    assert f"metrics port {swarm.port}" in line


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("DEADLINE_S", "nan"),
        ("DEADLINE_S", "5"),
        ("Q_MIN", "1.5"),
        ("COMM_RANGE_M", "inf"),
        ("HEADROOM", "0"),
        ("LINK_PRIOR_BPS", "fast"),
        ("FUSION_RATE_HZ", "-1"),
        ("KEEP_GROUND", "maybe"),
        ("EGO", "R/1"),
    ],
)
def test_a_setting_out_of_range_is_named_with_its_value(name: str, value: str) -> None:
    with pytest.raises(SettingError, match=f"COADAPT_{name}") as error:
        load_settings({f"COADAPT_{name}": value})
    assert value in str(error.value)


def test_the_defaults_are_those_of_the_live_system() -> None:
    settings = load_settings({})
    assert (settings.ego, settings.policy, settings.period_s) == ("R1", "coverage", 1.0)
    assert (settings.fusion_rate_hz, settings.deadline_s, settings.q_min) == (10.0, 0.25, 0.6)
    assert (settings.comm_range_m, settings.headroom) == (None, 0.8)
    assert (settings.link_prior_bps, settings.max_error_m) == (55e6, 0.1)
    assert not settings.keep_ground
    assert settings.journal == ""
