"""What grows with the robots in range is found by search trees; here beside the plain way, which
holds everything against everything."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ego_agent.analyze import doubts
from ego_agent.analyze.doubts import doubted
from ego_agent.analyze.merge import are_near, merge_nearby
from ego_agent.knowledge.model import RobotView, Snapshot
from ego_agent.knowledge.objective import Objective
from perception.detector import configuration
from swarm.arrays import unpack_finite
from swarm.geometry import TWO_PI
from tests.support.ego_scenes import objects, snapshot, view

BODY = configuration("factory").usual_body
SEEDS = range(20)


@pytest.mark.parametrize("seed", SEEDS)
def test_points_near_a_place_are_those_that_measuring_all_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-20, 20, (rng.integers(0, 400), 2))
    places = rng.uniform(-22, 22, (rng.integers(0, 60), 2))
    places[:1] = 1e308, -1e308
    exact = places[1:9]
    xy[: len(exact)] = exact[: len(xy)]
    xy[: len(exact), 0] += 1.0
    gaps = np.clip(xy[:, None] - places[None], -2.0, 2.0)
    plain = ((gaps**2).sum(axis=2) <= 1.0).any(axis=1)
    assert np.array_equal(are_near(xy, places, 1.0), plain)


@pytest.mark.parametrize("seed", SEEDS)
def test_points_of_one_block_get_one_number_as_rows_of_a_table_do(seed: int) -> None:
    """Blocks far apart, with one point each, are the groups, in the order of their rows."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-70, 70, (200, 2))
    far = 1000.0 * np.floor(xy / 20.0) + rng.uniform(0.0, 0.01, xy.shape)
    _, plain = np.unique(np.floor(xy / 20.0), axis=0, return_inverse=True)
    assert np.array_equal(merge_nearby(far, rng.uniform(0.1, 1, 200), 1.5), plain.reshape(-1))


def crowd(rng: np.random.Generator, robots: int) -> Snapshot:
    """Robots close together, some where others stand, that see things and one another, or not."""
    spread = rng.uniform(3.0, 25.0)
    places = rng.uniform(-spread, spread, (robots, 2))
    if rng.random() < 0.5:
        places[-1] = places[0] + rng.normal(0.0, 0.2, 2)
    views: list[RobotView] = []
    for number, (x, y) in enumerate(places):
        seen = places[rng.random(robots) < 0.3] + rng.normal(0.0, 0.5, 2)
        sectors = int(rng.choice([0, 24, 72, 360]))
        views.append(
            view(
                "E" if number == 0 else f"R{number}",
                float(x),
                float(y),
                sees=objects(*[(float(a), float(b), 20.0) for a, b in seen]),
                visible=[float(reach) for reach in rng.uniform(0.0, 60.0, sectors)],
            )
        )
    return snapshot(*views)


def plain_doubts(crowded: Snapshot) -> dict[str, str]:
    """`doubted`, each witness beside each place."""
    robots = list(crowded.robots)
    told = [crowded.robots[robot].beacon for robot in robots]
    places = np.array([beacon.pose[:2] for beacon in told if beacon is not None])
    sizes = np.array([(b.body or BODY).size[:2] for b in told if b is not None])
    for_it, against = np.zeros(len(robots), int), np.zeros(len(robots), int)
    for index, robot in enumerate(robots):
        there, free = plain_witness(crowded.robots[robot], places, sizes)
        there[index] = free[index] = False
        for_it += there
        against += free
    found = {}
    for index, robot in enumerate(robots):
        apart = np.hypot(*(places - places[index]).T)
        apart[index] = np.inf
        other = int(apart.argmin())
        if robot == crowded.ego:
            continue
        if apart[other] < doubts.OVERLAP * sizes[index, 1]:
            found[robot] = f"it says to stand where {robots[other]} stands"
        elif against[index] >= doubts.WITNESSES and against[index] > for_it[index]:
            found[robot] = f"{against[index]} robots see free ground where it says to stand"
    return found


def plain_witness(
    told: RobotView, places: NDArray[np.float64], sizes: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    assert told.scene is not None
    visible = unpack_finite(told.scene.visible_m, "visible_m", 1)[:, 0]
    things = unpack_finite(told.scene.objects, "objects", 9)[:, :2].astype(np.float64)
    there, free = np.zeros(len(places), bool), np.zeros(len(places), bool)
    reach = np.hypot(*sizes.T) / 2.0
    if len(things):
        apart = np.hypot(*(things[None] - places[:, None]).transpose(2, 0, 1))
        there = apart.min(axis=1) <= reach + doubts.SAME_M
    if len(visible):
        offset = places - np.array(told.scene.pose[:2])
        away = np.hypot(*offset.T)
        sector = np.arctan2(offset[:, 1], offset[:, 0]) / TWO_PI % 1.0 * len(visible)
        seen_m = visible[np.minimum(sector.astype(np.intp), len(visible) - 1)]
        wide = doubts.FILLED * away * TWO_PI / len(visible)
        fine = (away > reach) & (sizes.max(axis=1) >= wide)
        free = fine & ~there & (seen_m >= away + reach + doubts.BEYOND_M)
    return there, free


def test_a_crowd_doubts_whom_it_doubts_when_all_are_asked_about_all() -> None:
    kinds = set()
    for seed in range(60):
        rng = np.random.default_rng(seed)
        crowded = crowd(rng, int(rng.integers(2, 40)))
        found = doubted(crowded, Objective(), BODY)
        assert found == plain_doubts(crowded)
        kinds |= {reason.split(" ", 1)[0] for reason in found.values()}
    assert "it" in kinds, "no two of these robots stand in one place"
    assert len(kinds) > 1, "through none of these robots the ground is seen"


def test_a_place_beyond_all_measure_is_nobodys_neighbour() -> None:
    endless = view("R2", 1e300, -1e300, visible=[50.0] * 72, sees=objects((0.0, 0.0, 9.0)))
    far = snapshot(view("E", 0.0, 0.0), endless, view("R3", 1e308, 1e308))
    assert doubted(far, Objective(), BODY) == {}
