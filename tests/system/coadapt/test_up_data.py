"""What `coadapt up` says of recorded data before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from coadapt.main import main
from tests.support.world_bags import ROAD_SEED, write_bags
from worlds.road.world import RoadWorld

SWARM = "never"


@pytest.fixture
def cars(tmp_path: Path) -> Path:
    return write_bags(tmp_path / "cars", RoadWorld(robots=2, seed=ROAD_SEED), range(4))


def up(data: Path, *options: str) -> int:
    return main(["up", "--world", "bag", "--data", str(data), "--swarm", SWARM, *options])


def test_a_detector_that_does_not_suit_is_told(
    cars: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (cars / "world.toml").write_text('detector = "factory"\n')
    # A robot that is not there ends it before anything starts.
    assert up(cars, "--ego", "R9") == 1
    said = capsys.readouterr().err
    assert "detector factory does not suit the scans: the sensors stand 1.9 m" in said
    assert "has the robots R1, R2" in said
    assert "'R9'" in said


def test_a_wrong_clock_is_told_with_its_remedy(
    cars: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bags(cars / "later", RoadWorld(robots=2, seed=ROAD_SEED), range(4), {"R2": 3600.0})
    assert up(cars / "later") == 1
    assert "clock_offset_s = 3600.000" in capsys.readouterr().err
