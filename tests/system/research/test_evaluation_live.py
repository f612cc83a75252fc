"""`coadapt eval live`: what a real swarm delivers is what the experiment says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from coadapt.main import main
from deploy.runtimes.netns import NetnsRuntime
from deploy.state import read_state
from perception.types import Boxes
from research.evaluation.live.compare import compare_live
from research.evaluation.live.run import agreement, live_suite
from research.evaluation.live.swarm import Recorded
from research.evaluation.windows import links
from research.evaluation.windows.scenarios import Scenario
from research.training.plans import TEST_SEEDS
from swarm.arrays import pack
from swarm.messages import Detections
from worlds.cooperative.fusing import fuse_frame

SCENARIO = Scenario("live", 3, links.shift(), TEST_SEEDS.start + 555_558)


def message(frame: int, boxes: Boxes, sizes: dict[str, int], **more: object) -> Detections:
    table = [
        [*center, *size, heading]
        for center, size, heading in zip(boxes.centers, boxes.sizes, boxes.headings, strict=True)
    ]
    fields = {
        "ego": "R1",
        "cycle": 1,
        "frame": frame,
        "capture_ns": 0,
        "algorithm": "late",
        "participants": ("R1", *sizes),
        "boxes": pack(np.array(table, dtype=np.float32).reshape(-1, 7)),
        "scores": pack(boxes.scores.astype(np.float32).reshape(-1, 1)),
        "labels": boxes.labels,
        "bytes": sizes,
        "latency_ms": 40.0,
    }
    return Detections(**{**fields, **more})  # type: ignore[arg-type]


def delivered(frame: int) -> Detections:
    """What a swarm without any fault delivers of a frame."""
    fused = fuse_frame(SCENARIO.open(), frame, "R1", ["R2"], "late")
    return message(frame, fused.boxes, fused.bytes)


def test_a_faultless_swarm_agrees_with_the_experiment() -> None:
    frames = tuple(delivered(frame) for frame in (10, 11, 12))
    row = compare_live(SCENARIO, "static-late", 5_000_000, Recorded(0.5, frames))
    assert (row.frames_due, row.frames_fused, row.frames_complete) == (5, 3, 3)
    assert row.delivered_ratio == pytest.approx(0.6)
    assert row.ap_70_live == pytest.approx(row.ap_70_offline, abs=1e-6)
    assert row.bytes_live == row.bytes_offline
    assert row.algorithms == {"late": 3}
    assert agreement([row])["ap_70_agrees"]
    assert agreement([row])["bytes_agree"]


def test_what_was_lost_or_changed_on_the_way_shows() -> None:
    whole = delivered(10)
    fused = fuse_frame(SCENARIO.open(), 10, "R1", ["R2"], "late")
    nothing = message(11, Boxes.empty(), {"R2": 2 * fused.bytes["R2"]})
    cut = message(12, fused.boxes, fused.bytes, missing={"R3": "late"})
    row = compare_live(SCENARIO, "static-late", 5_000_000, Recorded(0.3, (whole, nothing, cut)))
    assert (row.frames_fused, row.frames_complete, row.frames_compared) == (3, 2, 2)
    found = agreement([row])
    assert not found["ap_70_agrees"]
    assert not found["bytes_agree"]


def test_a_swarm_that_delivers_nothing_has_no_precision() -> None:
    row = compare_live(SCENARIO, "static-late", 5_000_000, Recorded(1.0, ()))
    assert row.delivered_ratio == 0
    assert row.ap_70_live is row.bytes_live is row.latency_ms_p50 is None
    assert not agreement([row])["bytes_agree"]


def test_the_live_suite_is_small_and_clean() -> None:
    assert [scenario.robots for scenario in live_suite()] == [3, 4]
    assert not any(scenario.pose_noise_m for scenario in live_suite())


def test_a_real_swarm_is_compared_and_gone_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if (why := NetnsRuntime().available()) is not None:
        pytest.skip(f"no network namespaces: {why}")
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path / "run"))
    # Few frames that wait long for everybody, so that some are complete on a busy machine, too.
    monkeypatch.setenv("COADAPT_FUSION_RATE_HZ", "2")
    monkeypatch.setenv("COADAPT_DEADLINE_S", "4")
    monkeypatch.setattr("research.evaluation.live.run.LINKS_BPS", (20_000_000,))
    monkeypatch.setattr("research.evaluation.live.run.ROBOTS", (3,))
    options = ["--policies", "static-late", "--seconds", "10", "--runtime", "netns"]
    assert main(["eval", "live", *options, "--output", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "live.json").read_text())
    (row,) = report["rows"]
    assert row["frames_compared"] > 0
    assert row["bytes_live"] == pytest.approx(row["bytes_offline"], rel=0.02)
    # Robots that a busy machine starves lag by a scan or two; of another world nothing would match.
    assert row["ap_70_live"] == pytest.approx(row["ap_70_offline"], abs=0.3)
    assert (tmp_path / "live.md").read_text().count("floor-3") == 1
    for path in (tmp_path / "run").glob("eval-*"):
        assert read_state(path.name) is None
