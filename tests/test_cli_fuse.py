"""`coadapt fuse` and `coadapt ap` as a user calls them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest


def coadapt(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "coadapt.main", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_fuse_prints_one_object_of_boxes_and_bytes(opv2v_dir: Path) -> None:
    done = coadapt(
        *("fuse", str(opv2v_dir), "--frame", "006224", "--ego", "302"),
        *("--participants", "302,311", "--algorithm", "late", "--pose-noise", "0.2", "--json"),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result) == {"boxes", "bytes", "elapsed_ms"}
    assert list(result["bytes"]) == ["311"]
    assert len(result["boxes"]) > 10
    for box in result["boxes"]:
        assert set(box) == {"center", "size", "heading", "score", "label"}
        assert 0 <= box["score"] <= 1
        assert 0 <= box["heading"] < 6.2832


def test_ap_prints_the_figures(opv2v_dir: Path) -> None:
    done = coadapt("ap", str(opv2v_dir), "--algorithm", "late", "--delay", "0.1", "--json")
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert 0 < figures["ap_70"] <= figures["ap_50"] <= figures["ap_30"] <= 1
    assert figures["frames"] == 16
    assert figures["ground_truth"] > 100
    assert figures["bytes_per_robot_frame"] > 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("--frame", "7777"), "frame '7777' is not in"),
        (("--ego", "R7"), "robot 'R7' is not in"),
        (("--participants", "302,nobody"), "robot 'nobody' is not in"),
        (("--algorithm", "intermediate"), "'intermediate' is not available"),
        (("--algorithm", "magic"), "'magic' is not available; allowed: early, late"),
    ],
)
def test_a_wrong_name_is_one_line_and_exit_1(
    opv2v_dir: Path, change: tuple[str, str], words: str
) -> None:
    options = {"--frame": "0", "--algorithm": "late"} | dict([change])
    flat = [word for pair in options.items() for word in pair]
    done = coadapt("fuse", str(opv2v_dir), *flat)
    assert done.returncode == 1
    assert words in done.stderr
    assert done.stdout == ""
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("noise", ["-1", "much", "nan"])
def test_wrong_usage_is_exit_2(noise: str) -> None:
    done = coadapt("ap", ".", "--algorithm", "late", "--pose-noise", noise)
    assert done.returncode == 2
    assert "not a number >= 0" in done.stderr
