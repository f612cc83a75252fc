"""`coadapt fuse` and `coadapt ap` as a user calls them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from perception.fusion.registry import fusion_names
from tests.support.ego_swarm import float32
from tests.support.opencood_models import settings, write_model


def coadapt(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Each call would run the detector in what it finds fastest, and two would differ."""
    return subprocess.run(
        [sys.executable, "-m", "coadapt.main", *arguments],
        capture_output=True,
        text=True,
        timeout=240,
        env=os.environ | float32(),
        check=False,
    )


def test_fuse_prints_one_object_of_boxes_and_bytes(opv2v_dir: Path) -> None:
    done = coadapt(
        *("fuse", str(opv2v_dir), "--frame", "006224", "--ego", "302"),
        *("--participants", "302,311", "--algorithm", "late", "--pose-noise", "0.2", "--json"),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result) == {"boxes", "known", "bytes", "elapsed_ms"}
    assert [one["robot"] for one in result["known"]] == ["311"]
    assert list(result["bytes"]) == ["311"]
    assert len(result["boxes"]) > 10
    for box in (*result["boxes"], *result["known"]):
        assert set(box) - {"robot"} == {"center", "size", "heading", "score", "label"}
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
    assert 0 < figures["ap_70_per_frame"] <= figures["ap_70"]
    assert figures["ap_70_with_known"] > 0
    assert figures["precision"] > 0.8
    assert figures["recall"] > 0.5
    assert 0 <= figures["false_per_frame"] < 3
    options = ("--algorithm", "late", "--delay", "0.1", "--per-frame", "--json")
    per_frame = json.loads(coadapt("ap", str(opv2v_dir), *options).stdout)
    assert per_frame["ap_70"] == figures["ap_70_per_frame"]
    assert per_frame["ground_truth"] == figures["ground_truth"]


def test_a_vehicle_by_itself_is_judged_by_what_it_sees(opv2v_dir: Path, tmp_path: Path) -> None:
    one = tmp_path / "one"
    one.mkdir()
    for path in opv2v_dir.iterdir():
        if path.name != "311":
            (one / path.name).symlink_to(path)
    alone = json.loads(coadapt("ap", str(one), "--algorithm", "early", "--json").stdout)
    with_other = json.loads(
        coadapt("ap", str(opv2v_dir), "--ego", "302", "--algorithm", "early", "--json").stdout
    )
    assert (alone["frames"], alone["bytes_per_robot_frame"]) == (16, 0.0)
    # What the other one alone shows does not count, and the other one itself is an object now.
    assert 100 < alone["ground_truth"] < with_other["ground_truth"]
    assert alone["precision"] > 0.9


@pytest.mark.parametrize("algorithm", ["single", *fusion_names("road")])
def test_every_algorithm_fuses_noisy_and_old_contributions(opv2v_dir: Path, algorithm: str) -> None:
    done = coadapt(
        *("fuse", str(opv2v_dir), "--frame", "5", "--algorithm", algorithm),
        *("--pose-noise", "0.2", "--delay", "0.1", "--json"),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert len(result["boxes"]) > 0
    assert len(result["bytes"]) == (0 if algorithm == "single" else 1)


def test_an_opencood_model_fuses_as_it_was_trained(opv2v_dir: Path, tmp_path: Path) -> None:
    model = write_model(tmp_path, settings("Intermediate", 2))
    done = coadapt("fuse", str(opv2v_dir), "--frame", "0", "--opencood", str(model), "--json")
    assert done.returncode == 0, done.stderr
    (size,) = json.loads(done.stdout)["bytes"].values()
    # 16 x 8 x 4 numbers of two bytes would be the smallest map; early and late send no such size.
    assert size > 1024
    wrong = coadapt("ap", str(opv2v_dir), "--opencood", str(tmp_path / "nothing"))
    assert wrong.returncode == 1
    assert len(wrong.stderr.strip().splitlines()) == 1


def test_help_names_every_algorithm() -> None:
    for command in ("ap", "fuse"):
        words = coadapt(command, "--help").stdout
        for name in ("early", "late", "intermediate-sparse", "intermediate-codebook", "single"):
            assert name in words.replace("-\n" + " " * 24, "-")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("--frame", "7777"), "frame '7777' is not in"),
        (("--ego", "R7"), "robot 'R7' is not in"),
        (("--participants", "302,nobody"), "robot 'nobody' is not in"),
        (("--algorithm", "magic"), "'magic' is not available"),
        (("--algorithm", "magic"), "; allowed: early, "),
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
