"""`coadapt eval-detector`: which frames, which rows, and the file."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from coadapt.main import main
from perception.tally import Tally
from research.evaluation.detector import Case, algorithms_of, cases, measure
from research.evaluation.result_store import ResultStore
from research.evaluation.splits import FIRST_FRAME, Part, nearest_first, simulated
from research.training.plans import TEST_SEEDS
from worlds.factory.world import FactoryWorld

pytestmark = pytest.mark.slow

KEYS = {
    "world", "algorithm", "robots", "pose_sigma_m", "delay_s", "ap_30", "ap_50", "ap_70",
    "bytes_per_robot_frame",
}  # fmt: skip


@pytest.mark.parametrize(("world", "period"), [("factory", 6000), ("road", 100)])
def test_the_split_has_many_worlds_that_training_never_saw(world: str, period: int) -> None:
    parts = simulated(world, 500)
    assert sum(len(part.frames) for part in parts) >= 500
    assert len({part.seed for part in parts}) >= 50
    assert all(part.seed in TEST_SEEDS for part in parts)
    assert len({part.ego for part in parts}) > 1
    for part in parts:
        assert part.frames[0] >= FIRST_FRAME
        assert part.frames[-1] < period
        assert min(b - a for a, b in zip(part.frames, part.frames[1:], strict=False)) >= 18


def test_every_algorithm_meets_every_disturbance() -> None:
    rows = cases("factory", algorithms_of("factory"))
    assert len(set(rows)) == len(rows)
    late = [row for row in rows if row.algorithm == "late"]
    assert sorted(row.robots for row in late if row == Case("late", row.robots)) == [
        2, 3, 4, 5, 6,
    ]  # fmt: skip
    assert {row.disturbance.pose_noise_m for row in late} == {0.0, 0.2, 0.4, 0.6}
    assert {row.disturbance.delay_s for row in late} == {0.0, 0.1, 0.3, 0.5}
    assert [row.disturbance.pose_noise_m for row in late if not row.corrected] == [0.0, 0.4]
    assert [row.robots for row in rows if row.algorithm == "single"] == [1]
    assert all(row.algorithm == "late" for row in cases("road", ["late"]))


def test_helpers_are_the_nearest_robots() -> None:
    world = FactoryWorld(robots=6)
    order = nearest_first(world, "R4", 30)
    assert order[0] == "R4"
    here = world.pose("R4", 30)
    apart = [world.pose(robot, 30).distance_to(here) for robot in order]
    assert apart == sorted(apart)
    assert set(order) == set(world.robots)


def test_more_robots_find_more() -> None:
    part = Part("factory", TEST_SEEDS.start, None, 0, (FIRST_FRAME,))
    rows = [Case("late", robots) for robots in (2, 6)]
    tallies = measure(part, rows)
    ap = {row.robots: tally.precision().ap_50 for row, tally in zip(rows, tallies, strict=True)}
    assert ap[2] < ap[6]


def test_the_command_writes_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = tmp_path / "eval" / "detector.json"
    options = ["--worlds", "factory", "--algorithms", "single,early-uncoded", "--frames", "5"]
    status = main(["eval-detector", *options, "--workers", "1", "--output", str(report)])
    assert status == 0
    written = json.loads(report.read_text())
    assert {row["algorithm"] for row in written["rows"]} == {"single", "early-uncoded"}
    for row in written["rows"]:
        assert set(row) > KEYS
        assert row["frames"] == 5
        assert 0 <= row["ap_70"] <= row["ap_50"] <= row["ap_30"] <= 1
        assert set(row["classes"]) <= {"person", "robot", "forklift"}
        assert (row["bytes_per_robot_frame"] > 0) == (row["robots"] == 6)
    assert written["machine"]["cores"]
    assert "factory: 5/5 frames" in capsys.readouterr().err


def test_a_killed_run_leaves_no_worker_and_goes_on_where_it_was(tmp_path: Path) -> None:
    report = tmp_path / "detector.json"
    options = ["--worlds", "factory", "--algorithms", "single", "--workers", "1"]
    options += ["--output", str(report)]
    command = [sys.executable, "-m", "coadapt.main", "eval-detector", *options]
    with subprocess.Popen([*command, "--frames", "500"], stderr=subprocess.PIPE, text=True) as run:
        assert run.stderr is not None
        assert "factory: 5/500 frames" in run.stderr.readline()
        tasks = Path(f"/proc/{run.pid}/task").glob("*/children")
        workers = [int(pid) for task in tasks for pid in task.read_text().split()]
        assert workers
        run.kill()
    for pid in workers:
        with suppress(ProcessLookupError):
            ended = os.pidfd_open(pid)
            assert select.select([ended], [], [], 60)[0], f"worker {pid} still runs"
            os.close(ended)
    assert not report.exists()
    assert main(["eval-detector", *options, "--frames", "5"]) == 0
    written = json.loads(report.read_text())
    assert [row["frames"] for row in written["rows"]] == [5]
    assert written["frames_per_s"] == {}, "its first floor was measured again"


def test_what_was_kept_gives_the_same_precision(tmp_path: Path) -> None:
    part = Part("factory", TEST_SEEDS.start, None, 0, (FIRST_FRAME,))
    (tally,) = measure(part, [Case("late", 3)])
    kept = ResultStore(tmp_path, ["perception"])
    assert kept.get("late") is None
    kept.put("late", tally.packed())
    late = kept.get("late")
    assert late is not None
    again = Tally.unpacked(late)
    for label in ("", *tally.classes()):
        assert again.precision(label) == tally.precision(label)
    (path,) = tmp_path.rglob("*.bin")
    path.write_bytes(path.read_bytes()[:-5])
    assert kept.get("late") is None, "half a file is none"


def test_a_missing_sample_is_said_and_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("worlds.sample.SAMPLE", "no-such")
    status = main(["eval-detector", "--worlds", "opv2v", "--output", str(tmp_path / "d.json")])
    assert status == 1
    assert "opv2v: skipped: no OPV2V sample in " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--worlds", "moon"], "world 'moon' is not known; allowed: factory, road, opv2v"),
        (["--algorithms", "magic"], "algorithm 'magic' is not available; allowed: single, early"),
    ],
)
def test_wrong_names_are_refused(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["eval-detector", *options]) == 1
    assert words in capsys.readouterr().err
