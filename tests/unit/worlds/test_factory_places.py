"""The factory's places lie where its equipment and aisles do."""

from __future__ import annotations

import numpy as np
import pytest

from worlds.factory.layout import build_floor
from worlds.factory.places import Polygon, named_places


def holds(polygon: Polygon, x: float, y: float) -> bool:
    (x0, y0), _, (x1, y1), _ = polygon
    return x0 <= x <= x1 and y0 <= y <= y1


@pytest.mark.parametrize("robots", [2, 6, 12, 30])
def test_every_block_is_named_and_no_aisle_runs_through_one(robots: int) -> None:
    floor = build_floor(robots, np.random.default_rng(3))
    places = named_places(floor)
    for block in floor.blocks:
        names = {name for name, polygon in places if holds(polygon, block.x, block.y)}
        kinds = {"shelving": {"racks"}, "machines": {"machines"}, "conveyor": {"conveyors"}}
        assert names - {"docks"} == kinds[block.kind]
    for name, polygon in places:
        corners = np.array(polygon)
        assert (corners >= 0).all()
        assert (corners <= (floor.width_m, floor.depth_m)).all()
        assert not name.startswith("aisle") or np.ptp(corners[:, 1]) == pytest.approx(floor.depth_m)


def test_the_usual_floor_has_the_places_that_people_speak_of() -> None:
    names = [name for name, _ in named_places(build_floor(6, np.random.default_rng(1)))]
    assert set(names) == {
        "aisle 1", "aisle 2", "aisle 3", "cross aisle 1", "cross aisle 2", "cross aisle 3",
        "crossing", "docks", "racks", "machines", "conveyors",
    }  # fmt: skip
    assert names.count("racks") == 2
    assert names.count("crossing") == 1
