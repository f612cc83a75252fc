"""Which detector bags of cars and of carriers get, and how far their robots reach."""

from __future__ import annotations

from pathlib import Path

import pytest

from ego_agent.settings import EgoSettings
from options.bags.world import BagWorld
from tests.support.bag_files import plain_log
from tests.support.world_bags import ROAD_SEED, write_bags
from worlds.base import comm_range_of
from worlds.cooperative.fusing import fuse_frame
from worlds.factory.world import FactoryWorld
from worlds.remarks import remarks
from worlds.road.world import RoadWorld


@pytest.fixture(scope="module")
def cars(tmp_path_factory: pytest.TempPathFactory) -> Path:
    world = RoadWorld(robots=2, seed=ROAD_SEED)
    return write_bags(tmp_path_factory.mktemp("cars"), world, range(6))


@pytest.fixture(scope="module")
def carriers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    world = FactoryWorld(robots=2, rings=16)
    return write_bags(tmp_path_factory.mktemp("carriers"), world, range(6))


def test_range_and_detector_follow_from_what_cars_recorded(cars: Path) -> None:
    world = BagWorld(cars)
    assert world.detector == "road"
    assert world.range_m == 120.0
    (choice,) = world.choices
    assert choice.startswith("detector road is taken by what the scans are like: ")
    assert "1.9 m over ground" in choice
    assert 55 < world.pose("R1", 0).distance_to(world.pose("R2", 0)) < 65
    assert comm_range_of(world) == 70.0
    assert EgoSettings().objective(comm_range_of(world)).comm_range_m == 70.0
    assert EgoSettings(comm_range_m=50.0).objective(comm_range_of(world)).comm_range_m == 50.0
    assert list(remarks(world)) == [choice]
    assert len(fuse_frame(world, 3, "R1", ["R2"], "late").boxes) > 3


def test_carriers_keep_the_detector_that_they_had(carriers: Path) -> None:
    world = BagWorld(carriers)
    assert world.detector == "factory"
    assert comm_range_of(world) == 45.0
    assert list(remarks(world)) == list(world.choices)


def test_world_toml_has_the_last_word(cars: Path, tmp_path: Path) -> None:
    for bag in cars.iterdir():
        (tmp_path / bag.name).symlink_to(bag)
    (tmp_path / "world.toml").write_text('detector = "factory"\ncomm_range_m = 64.5\n')
    world = BagWorld(tmp_path)
    assert (world.detector, world.choices) == ("factory", ())
    assert comm_range_of(world) == 64.5


@pytest.mark.stumble(
    "a detector that does not suit the scans goes unnoticed",
    command="make up WORLD=bag DATA=cars",
)
def test_a_detector_that_does_not_suit_is_told_with_the_reasons(
    cars: Path, carriers: Path, tmp_path: Path
) -> None:
    for folder, name, words in (
        (cars, "factory", ("stand 1.9 m over the ground, it knows 1.0 to 1.6 m", "reach")),
        (carriers, "road", ("stand 1.2 m over the ground, it knows 1.5 to 2.3 m",)),
    ):
        data = tmp_path / name
        data.mkdir()
        for bag in folder.iterdir():
            (data / bag.name).symlink_to(bag)
        (data / "world.toml").write_text(f'detector = "{name}"\n')
        (remark,) = remarks(BagWorld(data))
        assert remark.startswith(f"detector {name} does not suit the scans: ")
        assert all(word in remark for word in words)


def test_scans_that_tell_nothing_keep_the_usual_detector(tmp_path: Path) -> None:
    plain_log([0.0, 0.1, 0.2]).write(tmp_path / "R1")
    world = BagWorld(tmp_path)
    assert (world.detector, world.choices) == ("factory", ())
    assert list(remarks(world)) == []
