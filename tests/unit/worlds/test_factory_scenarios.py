"""The three motivating snapshots of the paper happen."""

from __future__ import annotations

import numpy as np
import pytest

from swarm.geometry import transform
from worlds.factory.scenarios import CLUSTER, CLUSTER_GAP_M, OCCLUSION_AT_S, OCCLUSION_EVERY_S
from worlds.factory.world import FactoryWorld


def seen(world: FactoryWorld, robot: str, frame: int) -> dict[str, int]:
    """Points of one scan on each actor that is seen."""
    _, actors = world.scan_with_actors(robot, frame)
    counts = np.bincount(actors[actors >= 0], minlength=len(world.ground_truth(frame).ids))
    ids = world.ground_truth(frame).ids
    return {name: int(count) for name, count in zip(ids, counts, strict=True) if count}


@pytest.mark.parametrize("robots", [2, 6])
def test_the_forklift_hides_the_worker_from_the_ego_but_not_from_its_witness(robots: int) -> None:
    world = FactoryWorld(robots=robots, rings=16, scenario="transient-occlusion")
    hidden = set()
    for second in range(int(OCCLUSION_EVERY_S)):
        ego, witness = (seen(world, robot, second * 10).get("W1", 0) for robot in ("R1", "R2"))
        assert witness >= 10
        assert ego == 0 or ego >= 10 or second in {17, 18, 22, 23}
        if ego == 0:
            hidden.add(second)
    middle = int(OCCLUSION_AT_S)
    assert {middle - 1, middle, middle + 1} <= hidden
    assert hidden <= set(range(middle - 4, middle + 5))


def test_the_occlusion_comes_back_every_minute() -> None:
    world = FactoryWorld(rings=16, scenario="transient-occlusion")
    for minute in range(10):
        frame = round((OCCLUSION_AT_S + minute * OCCLUSION_EVERY_S) * world.rate_hz)
        assert "W1" not in seen(world, "R1", frame)
        assert seen(world, "R2", frame)["W1"] >= 10
        assert "W1" in seen(world, "R1", frame + 200)


def share_seen_by_one(world: FactoryWorld, frame: int) -> float:
    """Mean share of what R1 to R4 see together that one of them sees, in cells of 1 m."""
    views = []
    for robot in world.robots[:CLUSTER]:
        scan = world.scan(robot, frame)
        points = transform(scan.pose.matrix(), scan.points)
        views.append({tuple(cell) for cell in np.unique(np.floor(points), axis=0)})
    together = len(set.union(*views))
    return float(np.mean([len(view) / together for view in views]))


def test_robots_of_the_cluster_add_little_to_each_other() -> None:
    cluster = FactoryWorld(rings=16, scenario="redundant-cluster")
    floor = FactoryWorld(rings=16)
    frames = range(0, cluster.frame_count, 500)
    redundant = np.mean([share_seen_by_one(cluster, frame) for frame in frames])
    spread = np.mean([share_seen_by_one(floor, frame) for frame in frames])
    assert redundant > 1.4 * spread
    for frame in frames:
        poses = [cluster.pose(robot, frame) for robot in cluster.robots[:CLUSTER]]
        far = max(a.distance_to(b) for a in poses for b in poses)
        assert far <= (CLUSTER - 1) * CLUSTER_GAP_M + 1e-6


def test_the_bandwidth_drops_and_recovers() -> None:
    world = FactoryWorld(scenario="bandwidth-drop")
    rates = [world.link_rate_bps(t) for t in (0.0, 59.9, 60.0, 119.9, 120.0, 599.0, 600.0)]
    assert rates == [55e6, 55e6, 0.75e6, 0.75e6, 55e6, 0.75e6, 55e6]


@pytest.mark.parametrize("scenario", ["floor", "redundant-cluster", "transient-occlusion"])
def test_other_scenarios_leave_the_link_alone(scenario: str) -> None:
    assert FactoryWorld(scenario=scenario).link_rate_bps(70.0) is None


def test_the_bandwidth_drop_happens_on_the_usual_floor() -> None:
    drop, floor = FactoryWorld(scenario="bandwidth-drop"), FactoryWorld()
    assert drop.pose("R5", 123) == floor.pose("R5", 123)
