"""Two cars' own bags in real processes that are started by hand: the ego fuses both."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm.arrays import unpack_finite
from tests.support.ego_swarm import Swarm, swarm_of
from tests.support.world_bags import ROAD_SEED, write_bags
from worlds.road.world import RoadWorld


@pytest.fixture
def swarm(tmp_path: Path) -> Iterator[Swarm]:
    cars = tmp_path / "cars"
    write_bags(cars, RoadWorld(robots=2, seed=ROAD_SEED), range(12))
    (tmp_path / "processes").mkdir()
    world = {"COADAPT_WORLD": "bag", "COADAPT_WORLD_DATA": str(cars)}
    with swarm_of(world, tmp_path / "processes") as swarm:
        swarm.router()
        yield swarm


@pytest.mark.stumble(
    "bags of cars 60 m apart never fuse: the range stays 45 m",
    command="make up WORLD=bag DATA=cars ROBOTS=2",
)
def test_an_ego_started_by_hand_fuses_cars_that_are_60_m_apart(swarm: Swarm) -> None:
    frames = swarm.detections(swarm.session(), "R1")
    swarm.robot("R2")
    swarm.ego(ego="R1", period_s="0.25")
    fused = frames.until(
        lambda one: "R2" in one.participants and one.bytes.get("R2", 0) > 0 and len(one.labels) > 0
    )
    assert set(fused.labels) == {"vehicle"}, "the detector is that of cars, which nobody named"
    assert len(unpack_finite(fused.boxes, "boxes", 7)) == len(fused.labels)
