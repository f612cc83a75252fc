"""Points to pillars, and what the encoder makes of where they stand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from perception.detector.grid import bev_config
from perception.detector.pillars import MAX_POINTS, POINT_FEATURES, pillarise
from swarm.errors import PerceptionError
from tests.support.tiny_detector import TINY, random_cloud, random_network

PILLARS = 64 * 48


def cloud(*points: tuple[float, float, float]) -> torch.Tensor:
    return torch.tensor(points, dtype=torch.float32).reshape(-1, 3)


@pytest.mark.parametrize(
    ("column", "row", "expected"),
    [
        (0, 0, 0),
        (1, 0, 1),
        (0, 1, 2),
        (1, 1, 3),
        (2, 0, 4),
        (63, 0, 31 * 4 + 1),
        (0, 2, 32 * 4),
        (5, 7, (3 * 32 + 2) * 4 + 3),
        (63, 47, PILLARS - 1),
    ],
)
def test_the_pillars_of_a_cell_follow_each_other(column: int, row: int, expected: int) -> None:
    point = (-6.4 + 0.2 * column + 0.07, -4.8 + 0.2 * row + 0.13, 0.0)
    assert pillarise([cloud(point)], TINY).index.tolist() == [expected]


def test_features_are_offsets_from_mean_and_middle_height_and_count() -> None:
    # Two points in the first pillar, whose middle is (-6.3, -4.7), and one in another.
    pillars = pillarise([cloud((-6.35, -4.75, 0.2), (-6.25, -4.75, 0.4), (0.05, 0.12, -1))], TINY)
    expected = [
        [-0.05, 0.0, -0.1, -0.25, -0.25, 0.2, math.log(2) / 4],
        [0.05, 0.0, 0.1, 0.25, -0.25, 0.4, math.log(2) / 4],
        [0.0, 0.0, 0.0, -0.25, 0.1, -1.0, 0.0],
    ]
    assert pillars.features.shape == (3, POINT_FEATURES)
    assert torch.allclose(pillars.features, torch.tensor(expected), atol=1e-5)
    assert pillars.clouds == 1


@pytest.mark.parametrize(
    "point",
    [
        (6.41, 0.0, 0.0),
        (-6.41, 0.0, 0.0),
        (6.4, 0.0, 0.0),
        (0.0, 4.8, 0.0),
        (0.0, -4.9, 0.0),
        (0.0, 0.0, -1.5),
        (0.0, 0.0, 1.7),
        (0.0, 0.0, 1e30),
        (math.nan, 0.0, 0.0),
        (0.0, math.nan, 0.0),
        (0.0, 0.0, math.nan),
        (math.inf, 0.0, 0.0),
        (0.0, -math.inf, 0.0),
        (0.0, 0.0, -math.inf),
    ],
)
def test_points_off_the_grid_are_left_out(point: tuple[float, float, float]) -> None:
    inside = (1.0, 1.0, 0.0)
    with_it = pillarise([cloud(point, inside, point)], TINY)
    without = pillarise([cloud(inside)], TINY)
    assert torch.equal(with_it.features, without.features)
    assert torch.equal(with_it.index, without.index)


@pytest.mark.parametrize("name", ["factory", "road"])
def test_the_last_points_before_the_edges_lie_in_the_last_pillars(name: str) -> None:
    config = bev_config(name)
    x = np.nextafter(np.float32(config.half_x_m), np.float32(0))
    y = np.nextafter(np.float32(config.half_y_m), np.float32(0))
    corners = pillarise([cloud((x, y, 0.0), (-x, -y, 0.0), (x, -y, 0.0))], config).index.tolist()
    # In the last cell of the first row of cells, the second of the pillars.
    assert corners == [config.rows * config.columns - 1, 0, config.columns // 2 * 4 - 3]


def test_a_cloud_without_points_has_no_pillars_but_a_map() -> None:
    empty = pillarise([cloud()], TINY)
    assert empty.features.shape == (0, POINT_FEATURES)
    assert empty.index.shape == (0,)
    with torch.inference_mode():
        maps = random_network().encoder(empty)
    assert maps.shape == (1, 32, 24, 32)
    assert torch.isfinite(maps).all()


def test_ten_million_points_are_thinned_evenly() -> None:
    many = torch.zeros(10_000_000, 3)
    many[:, 0] = torch.linspace(-6, 6, len(many))
    pillars = pillarise([many], TINY)
    assert MAX_POINTS / 2 < len(pillars.index) <= MAX_POINTS
    counts = torch.bincount(pillars.index, minlength=PILLARS)
    counts = counts[counts > 0][1:-1]
    assert len(counts) > 50
    assert counts.max() - counts.min() <= 2


def test_a_cloud_of_the_most_points_is_not_thinned() -> None:
    cloud = random_cloud(count=1000).repeat(MAX_POINTS // 1000, 1)
    assert len(pillarise([cloud], TINY).index) == len(cloud)


def test_several_clouds_in_one_call_are_as_each_by_itself() -> None:
    clouds = [random_cloud(count=n, seed=n) for n in (300, 0, 1, 1500)]
    encoder = random_network().encoder
    together = pillarise(clouds, TINY)
    assert together.clouds == 4
    with torch.inference_mode():
        maps = encoder(together)
        for i, one in enumerate(clouds):
            alone = pillarise([one], TINY)
            mine = together.index // PILLARS == i
            assert torch.equal(together.index[mine] - i * PILLARS, alone.index)
            assert torch.equal(together.features[mine], alone.features)
            assert torch.allclose(maps[i], encoder(alone)[0], atol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_the_order_of_points_does_not_matter(seed: int) -> None:
    points = random_cloud(count=200, seed=seed)
    turned = torch.from_numpy(np.random.default_rng(seed).permutation(points.numpy()))
    encoder = random_network().encoder
    with torch.inference_mode():
        first, second = (encoder(pillarise([c], TINY)) for c in (points, turned))
    assert torch.allclose(first, second, atol=1e-4)


@pytest.mark.parametrize(("right", "up"), [(2, 0), (0, -2), (4, 2)])
def test_what_moves_by_whole_cells_is_seen_moved_by_whole_cells(right: int, up: int) -> None:
    # Pairs of cells: the wide half of the encoder sees them in pairs.
    config = replace(TINY, half_x_m=12.8, half_y_m=12.8)
    rng = np.random.default_rng(1)
    # Clear of the pillars' edges, where rounding would put a point into the one beside.
    pillar = rng.integers(-25, 25, (600, 2)) + rng.uniform(0.1, 0.9, (600, 2))
    points = np.column_stack([pillar * 0.2, rng.uniform(-1, 1, 600)]).astype(np.float32)
    moved = points + np.array([right * 0.4, up * 0.4, 0.0], dtype=np.float32)
    network = random_network(config)
    with torch.inference_mode():
        before, after = (
            network.encoder(pillarise([torch.from_numpy(c)], config))[0] for c in (points, moved)
        )
    inner = before[:, 16:48, 16:48]
    assert inner.std() > 0.01
    there = after[:, 16 + up : 48 + up, 16 + right : 48 + right]
    assert torch.allclose(inner, there, atol=1e-4)


def test_an_unknown_configuration_is_refused_with_those_there_are() -> None:
    with pytest.raises(PerceptionError, match=r"'sea' is not known; allowed: factory, road"):
        bev_config("sea")


def test_the_grids_are_those_of_the_field() -> None:
    factory, road = bev_config("factory"), bev_config("road")
    assert (factory.rows, factory.columns, factory.cells) == (256, 256, (128, 128))
    assert (road.rows, road.columns, road.cells) == (200, 704, (100, 352))
    assert road.cell_m == pytest.approx(0.8)


@pytest.mark.parametrize("points", [0, 1, 400])
def test_cells_computed_where_points_are_equal_those_computed_everywhere(points: int) -> None:
    encoder = random_network().encoder
    clouds = [cloud(), random_cloud(count=points)]
    pillars = pillarise(clouds, TINY)
    with torch.inference_mode():
        encoded = encoder.points(pillars.features)
        sparse = encoder._sparse(encoded, pillars, encoder._hit(pillars))
        assert torch.allclose(sparse, encoder._dense(encoded, pillars), atol=1e-6)
