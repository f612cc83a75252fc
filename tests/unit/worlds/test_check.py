"""`coadapt worlds`: what lies in a folder, and whether it will fuse."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coadapt.main import main
from tests.support.bag_files import plain_log
from tests.support.plain_scans import plain_scans
from tests.support.recording_files import write_recording
from tests.support.world_bags import ROAD_SEED, write_bags
from worlds.registry import world_kinds
from worlds.road.world import RoadWorld

Told = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str]) -> Told:
    """Exit status and JSON of a check."""

    def check(path: Path, *options: str) -> tuple[int, dict[str, Any]]:
        status = main(["worlds", "check", str(path), "--json", *options])
        return status, json.loads(capsys.readouterr().out)

    return check


@pytest.fixture(scope="module")
def cars(tmp_path_factory: pytest.TempPathFactory) -> Path:
    world = RoadWorld(robots=2, seed=ROAD_SEED)
    return write_bags(tmp_path_factory.mktemp("cars"), world, range(6))


@pytest.mark.stumble(
    "nothing tells whether own data will fuse", command="coadapt worlds check cars"
)
def test_bags_of_cars_will_fuse(cars: Path, told: Told) -> None:
    status, found = told(cars)
    assert (status, found["fuses"], found["against"]) == (0, True, [])
    assert (found["world"], found["found"]) == ("bag", "bags of 2 robots")
    assert (found["robots"], found["ego"], found["frames"]) == (["R1", "R2"], "R1", 6)
    assert found["rate_hz"] == found["timings"][0]["rate_hz"] == pytest.approx(10)
    assert found["overlap_s"] == found["span_s"] == pytest.approx(0.5)
    assert (found["skew"], found["unsuited"]) == (None, [])
    assert (found["detector"], found["comm_range_m"]) == ("road", 70)
    assert found["scans"]["height_m"] == pytest.approx(1.9, abs=0.1)
    (partner,) = found["partners"]
    assert 59 < partner["nearest_m"] <= partner["farthest_m"] < 61
    assert partner["within"] == 1
    assert 0.05 < partner["shared"] < 0.9
    assert found["gain"] > 1.2
    assert found["next"].endswith(f"WORLD=bag DATA={cars}")


def test_lines_are_few_and_end_with_what_to_type(
    cars: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["worlds", "check", str(cars)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 10 <= len(lines) <= 12
    assert not [line for line in lines if line.startswith("origins")]
    assert lines[0] == "found     bags of 2 robots (world bag)"
    assert "road: it suits" in lines[6]
    assert lines[-2].startswith("fuses     yes, in 100% of the frames")
    assert lines[-1].startswith("next      make up WORLD=bag DATA=")


def test_robots_out_of_range_will_not_fuse(cars: Path, tmp_path: Path, told: Told) -> None:
    for bag in cars.iterdir():
        (tmp_path / bag.name).symlink_to(bag)
    (tmp_path / "world.toml").write_text("comm_range_m = 50\n")
    status, found = told(tmp_path)
    assert (status, found["fuses"]) == (1, False)
    assert "no robot comes within 50 m of R1: R2, the nearest, is 60 m away" in found["against"][0]
    assert found["next"] == "mend what `fuses` says, and check again"
    (tmp_path / "world.toml").write_text('detector = "factory"\ncomm_range_m = 70\n')
    status, found = told(tmp_path, "--ego", "R2")
    assert (status, found["ego"]) == (0, "R2")
    assert found["unsuited"][0].startswith("detector factory does not suit the scans")


def test_robots_that_share_nothing_may_have_other_origins(
    tmp_path: Path, told: Told, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(4)
    for robot in ("R1", "R2"):
        (tmp_path / robot).mkdir()
        around = rng.uniform(-5, 5, size=(500, 3)).astype(np.float32)
        np.save(tmp_path / robot / "0.npy", around)
    (tmp_path / "world.toml").write_text(
        "[robots.R1]\norigin = {x = 0.0}\n[robots.R2]\norigin = {x = 20.0}\n"
    )
    status, found = told(tmp_path)
    assert (status, found["partners"][0]["shared"]) == (0, 0.0)
    assert found["gain"] == pytest.approx(2.0, abs=0.1)
    assert main(["worlds", "check", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "R2 sees almost nothing of what R1 sees, within range of it: do their poses" in said


def test_robots_in_one_place_may_have_origins_of_their_own(tmp_path: Path, told: Told) -> None:
    for robot in ("R1", "R2"):
        plain_log(np.arange(10) / 10).write(tmp_path / robot)
    assert told(tmp_path)[1]["apart"] == [
        "R2 comes within 0.0 m of R1, where there is no room for both"
    ]


@pytest.mark.stumble("a scan that cannot be read is not told", command="coadapt worlds check scans")
def test_scans_that_cannot_be_read_are_told_with_their_reason(tmp_path: Path, told: Told) -> None:
    data = plain_scans(tmp_path / "data")
    for file in (data / "R2").glob("*.npy"):
        file.write_bytes(b"no scan")
    status, found = told(data)
    assert status == 1
    (fault,) = found["unreadable"]
    assert fault.startswith("R2: ")
    assert "0.npy" in fault
    assert found["next"] == "mend what `damaged` and `fuses` say, and check again"


def test_one_robot_has_nobody_to_fuse_with(tmp_path: Path, told: Told) -> None:
    plain_log(np.arange(10) / 10).write(tmp_path / "R1")
    status, found = told(tmp_path)
    assert (status, found["against"]) == (1, ["R1 is alone: there is nobody to fuse with"])


def test_clocks_that_may_differ_are_told(tmp_path: Path, told: Told) -> None:
    for robot, later in (("R1", 0.0), ("R2", 1.0)):
        plain_log(np.arange(16) / 10 + later).write(tmp_path / robot)
    status, found = told(tmp_path)
    assert found["skew"] == ["R2", pytest.approx(1.0)]
    assert found["overlap_s"] == pytest.approx(0.5)
    assert status == 0


def test_a_recording_and_a_scenario_are_found_by_looking(
    tmp_path: Path, opv2v_dir: Path, told: Told
) -> None:
    path = write_recording(tmp_path / "run.mcap", range(3))
    status, found = told(path)
    assert (status, found["world"], found["detector"]) == (0, "recording", "factory")
    assert found["unsuited"] == []
    status, found = told(opv2v_dir)
    assert (status, found["world"], found["detector"]) == (0, "opv2v", "road")
    assert found["unsuited"] == []


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: None, "is not there"),
        (lambda path: path.mkdir(), "holds no data that is known; allowed: bag: the directory"),
        (lambda path: path.write_bytes(b"?"), "not an MCAP file"),
    ],
)
def test_what_is_no_data_is_told_with_what_could_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], make: Callable[[Path], object], words: str
) -> None:
    make(tmp_path / "data")
    assert main(["worlds", "check", str(tmp_path / "data")]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert words in said.err
    assert str(tmp_path / "data") in said.err


def test_one_bag_is_told_from_a_folder_of_bags(
    cars: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["worlds", "check", str(cars / "R1")]) == 1
    assert "give the folder that holds one bag a robot" in capsys.readouterr().err


def test_the_list_names_every_world(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["worlds"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(world_kinds())
