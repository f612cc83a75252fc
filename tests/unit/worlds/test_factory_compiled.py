"""The factory's rays hit the same in C and in Open3D and NumPy."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from perception.kernels.library import load
from swarm.errors import WorldError
from swarm.geometry import Pose
from tests.support.paths import REPOSITORY
from worlds.factory import lidar
from worlds.factory.actors import Solids
from worlds.factory.grid import RayGrid
from worlds.factory.layout import Floor
from worlds.factory.lidar import COLUMNS, HIGHEST_RAD, LOWEST_RAD, RANGE_M, RANGE_STEP_M
from worlds.factory.meshes import MeshRays
from worlds.factory.rays import CompiledRays, rays
from worlds.factory.world import FactoryWorld

SAME_M = 1e-4
GRAZING = 2e-4
"""Share of rays that may go past an edge here and hit it there."""

needs_compiled = pytest.mark.skipif(
    rays() is None, reason="the factory was installed without a compiler"
)


def without_c(**settings: object) -> FactoryWorld:
    """A factory whose rays Open3D casts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lidar, "rays", lambda: None)
        return FactoryWorld(**settings)  # type: ignore[arg-type]


def share_that_differs(
    in_c: tuple[NDArray[np.float32], NDArray[np.int16]],
    in_numpy: tuple[NDArray[np.float32], NDArray[np.int16]],
) -> float:
    """Of the rays that hit something in reach, those with another distance or another actor."""
    near = np.minimum(in_c[0], in_numpy[0]) < RANGE_M + 0.2
    assert near.any()
    distance, expected = in_c[0][near], in_numpy[0][near]
    other = ~(np.abs(distance - expected) < SAME_M) | (in_c[1][near] != in_numpy[1][near])
    return float(other.mean())


@needs_compiled
@pytest.mark.parametrize(
    "settings",
    [
        {"seed": 1},
        {"seed": 2, "rings": 16},
        {"seed": 3, "rings": 64},
        {"seed": 4, "scenario": "redundant-cluster"},
        {"seed": 5, "scenario": "transient-occlusion"},
        {"seed": 6, "robots": 40},
    ],
    ids=lambda settings: "-".join(map(str, settings.values())),
)
def test_rays_hit_the_same_actors_at_the_same_distance(settings: dict[str, object]) -> None:
    world, other = FactoryWorld(**settings), without_c(**settings)  # type: ignore[arg-type]
    shares = []
    for frame in range(3, world.frame_count, 1100):
        for index, robot in enumerate(world.robots[:3]):
            pose, bodies = world.pose(robot, frame), world._bodies(frame)
            shares.append(
                share_that_differs(
                    world._lidar._rays.cast(pose, index, bodies),
                    other._lidar._rays.cast(pose, index, bodies),
                )
            )
    assert np.mean(shares) < GRAZING


@needs_compiled
@pytest.mark.parametrize("rings", [16, 32, 64])
def test_scans_have_the_same_points(rings: int) -> None:
    world, other = FactoryWorld(rings=rings, seed=9), without_c(rings=rings, seed=9)
    for frame in (0, 2222, 4444):
        scan, actors = world.scan_with_actors("R4", frame)
        expected, expected_actors = other.scan_with_actors("R4", frame)
        assert np.array_equal(actors, expected_actors)
        apart = np.abs(scan.points - expected.points).max(axis=1)
        assert (apart > RANGE_STEP_M).mean() < GRAZING
        # Half-way between two steps the last bit says which.
        assert (apart > SAME_M).mean() < 1e-3
        assert scan.points.flags.c_contiguous


@needs_compiled
def test_noise_drop_out_and_order_are_the_same_to_the_bit() -> None:
    world, other = FactoryWorld(), without_c()
    world._lidar._rays = other._lidar._rays
    for robot in ("R1", "R6"):
        scan, actors = world.scan_with_actors(robot, 1234)
        expected, expected_actors = other.scan_with_actors(robot, 1234)
        assert np.array_equal(scan.points, expected.points)
        assert np.array_equal(actors, expected_actors)


def both_casters(rings: int) -> tuple[CompiledRays, MeshRays]:
    """On a floor with one pillar, far away."""
    library = rays()
    assert library is not None
    pillar = np.array([[33.0, 2.0, 0.0, 33.5, 2.5, 6.0]])
    floor = Floor(50.0, 50.0, (), pillar)
    grid = RayGrid(np.linspace(LOWEST_RAD, HIGHEST_RAD, rings), COLUMNS)
    return CompiledRays(library, floor, grid, RANGE_M), MeshRays(floor, grid, RANGE_M)


@needs_compiled
@pytest.mark.parametrize("rings", [16, 32, 64])
def test_bodies_all_around_above_below_and_near_the_sensor_are_hit_the_same(rings: int) -> None:
    compiled, meshes = both_casters(rings)
    rng = np.random.default_rng(rings)
    shares, hits = [], 0
    for _ in range(40):
        count = 12
        halves = rng.uniform([0.05, 0.05, 0.05], [3.0, 0.5, 1.0], (count, 3))
        # From within the cylinder around a box to beyond its reach.
        away = rng.uniform(0.5, 1.0, count) * rng.choice([0.1, 1.0, 3.0, 15.0, 45.0], count)
        azimuth = rng.uniform(-np.pi, np.pi, count)
        x, y, yaw = *rng.uniform(-20, 20, 2), rng.uniform(-9.0, 9.0)
        pose = Pose(x, y, 1.2, yaw=yaw)
        centers = np.column_stack(
            [
                pose.x + away * np.cos(azimuth),
                pose.y + away * np.sin(azimuth),
                rng.uniform(0.0, 3.0, count),
            ]
        )
        headings = rng.uniform(-9.0, 9.0, count)
        owner = rng.integers(0, 5, count).astype(np.int16)
        bodies = Solids(owner, centers, halves, headings)
        found, expected = compiled.cast(pose, 2, bodies), meshes.cast(pose, 2, bodies)
        shares.append(share_that_differs(found, expected))
        hits += int((found[1] >= 0).sum())
        assert 2 not in found[1]
    assert np.mean(shares) < GRAZING
    assert hits > 40 * COLUMNS


@needs_compiled
@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -np.pi / 2, 7 * np.pi])
def test_a_wall_of_one_body_is_hit_the_same_from_every_side(yaw: float) -> None:
    compiled, meshes = both_casters(32)
    for x, y in ((0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4), (5.0, 0.3), (-5.0, -0.2)):
        pose = Pose(0.0, 0.0, 1.2, yaw=yaw)
        wall = Solids(
            np.array([0], dtype=np.int16),
            np.array([[x, y, 1.0]]),
            np.array([[0.3, 8.0, 1.0]] if abs(x) > 0 else [[8.0, 0.3, 1.0]]),
            np.array([0.0]),
        )
        found, expected = compiled.cast(pose, -1, wall), meshes.cast(pose, -1, wall)
        assert (found[1] == 0).sum() > COLUMNS
        assert share_that_differs(found, expected) < GRAZING


@needs_compiled
def test_several_threads_get_the_same_scans() -> None:
    alone, shared = FactoryWorld(rings=16), FactoryWorld(rings=16)
    frames = range(0, 800, 100)
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda frame: shared.scan("R2", frame).points, frames))
    for frame, points in zip(frames, together, strict=True):
        assert np.array_equal(points, alone.scan("R2", frame).points)


@needs_compiled
def test_a_compiled_factory_needs_no_open3d() -> None:
    code = (
        "import sys; sys.modules['open3d'] = None\n"
        "from worlds.factory.world import FactoryWorld\n"
        "print(len(FactoryWorld(rings=16).scan('R1', 0).points))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, check=True
    )
    assert int(done.stdout) > 10_000


def test_with_neither_compiler_nor_open3d_the_missing_packages_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = without_c(rings=16)
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(WorldError, match=r"needs Open3D.*libegl1"):
        world.scan("R1", 0)


@needs_compiled
def test_a_cache_never_gives_scans_of_the_other_caster(tmp_path: Path) -> None:
    without_c(rings=16, cache=tmp_path).scan("R1", 3)
    kept = FactoryWorld(rings=16, cache=tmp_path).scan("R1", 3)
    assert np.array_equal(kept.points, FactoryWorld(rings=16).scan("R1", 3).points)
    assert len(list(tmp_path.iterdir())) == 2


@needs_compiled
def test_a_library_of_another_version_is_not_called() -> None:
    folder = REPOSITORY / "worlds" / "factory"
    assert load(folder, "_rays", 2, {"measure": "v ppp ll pp"}) is not None
    assert load(folder, "_rays", 0, {"measure": "v ppp ll pp"}) is None
    assert load(folder, "_rays", 2, {"not_there": "v"}) is None
    assert load(folder, "_nothing", 1, {}) is None
