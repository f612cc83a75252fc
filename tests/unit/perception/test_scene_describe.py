from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from perception.scene import METHODS, MIN_SIDE_M, Segmentation, describe, ground_mask, segment
from perception.types import Scene
from swarm.errors import PerceptionError, ScanError

Cloud = NDArray[np.float32]
SENSOR_HEIGHT = 1.8
BOXES = (((10.0, 4.0), (4.0, 1.8, 1.5)), ((-15.0, 8.0), (1.0, 1.0, 1.8)), ((3.0, -20.0), (2, 6, 3)))


def floor(slope: float = 0.0, reach: float = 30.0, step: float = 0.4) -> Cloud:
    axis = np.arange(-reach, reach, step)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    return np.stack([x, y, slope * x - SENSOR_HEIGHT], axis=1).astype(np.float32)


def box(center: tuple[float, float], size: tuple[float, float, float], slope: float = 0.0) -> Cloud:
    """Points on the four walls and the roof, from 0.3 m above the ground, 0.15 m apart."""
    axes = [np.linspace(0, side, max(2, round(side / 0.15) + 1)) for side in size]
    grid = np.stack([each.ravel() for each in np.meshgrid(*axes)], axis=1)
    shell = ((grid[:, :2] == 0) | np.isclose(grid[:, :2], size[:2])).any(axis=1)
    shell |= np.isclose(grid[:, 2], size[2])
    walls = grid[shell & (grid[:, 2] >= 0.3)]
    ground = slope * center[0] - SENSOR_HEIGHT
    corner = np.array([center[0] - size[0] / 2, center[1] - size[1] / 2, ground])
    return (walls + corner).astype(np.float32)


def world_of_boxes(slope: float = 0.0) -> Cloud:
    return np.concatenate([floor(slope), *(box(c, s, slope) for c, s in BOXES)])


def as_rows(scene: Scene) -> NDArray[np.float64]:
    rows = [(*o.centroid, o.distance, *o.size, o.points, o.density) for o in scene.objects]
    return np.array(sorted(rows)).reshape(-1, 9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_each_box_on_the_ground_is_one_object(method: str, slope: float) -> None:
    scene = describe(world_of_boxes(slope), method)
    assert len(scene.objects) == len(BOXES)
    for center, size in BOXES:
        found = min(scene.objects, key=lambda o: np.hypot(*np.subtract(o.centroid[:2], center)))
        assert found.centroid[:2] == pytest.approx(center, abs=0.3)
        assert found.size[:2] == pytest.approx(size[:2], abs=0.05)
        assert found.size[2] == pytest.approx(size[2] - 0.3, abs=0.5)


@pytest.mark.parametrize("method", METHODS)
def test_an_object_is_described_by_the_points_it_is_made_of(method: str) -> None:
    shape = box((10.0, 4.0), (2.0, 1.0, 1.5))
    (found,) = describe(np.concatenate([floor(), shape]), method).objects
    sides = shape.max(axis=0) - shape.min(axis=0)
    mean = shape.astype(np.float64).mean(axis=0)
    assert found.points == len(shape)
    assert found.centroid == pytest.approx(tuple(mean), abs=1e-6)
    assert found.distance == pytest.approx(np.linalg.norm(mean), abs=1e-6)
    assert found.size == pytest.approx(tuple(sides), abs=1e-6)
    assert found.density == pytest.approx(len(shape) / np.prod(sides), rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_all_of_the_floor_is_ground(method: str) -> None:
    assert describe(floor(), method) == Scene((), len(floor()))


@pytest.mark.parametrize("method", METHODS)
def test_a_flat_board_has_a_finite_density(method: str) -> None:
    y, z = (grid.ravel() for grid in np.meshgrid(np.arange(0, 2, 0.1), np.arange(0.5, 2, 0.1)))
    board = np.stack([np.full_like(y, 8.0), y, z - SENSOR_HEIGHT], axis=1).astype(np.float32)
    (found,) = describe(np.concatenate([floor(), board]), method).objects
    assert found.size[0] == 0.0
    expected = found.points / (MIN_SIDE_M * found.size[1] * found.size[2])
    assert found.density == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_the_own_body_is_no_object_unless_asked_for(method: str) -> None:
    hood = box((1.9, 0.0), (1.0, 1.6, 0.9))
    cloud = np.concatenate([floor(), hood])
    assert describe(cloud, method).objects == ()
    assert len(describe(cloud, method, own_body_m=0.0).objects) == 1


@pytest.mark.parametrize("method", METHODS)
def test_a_scan_has_one_description(method: str) -> None:
    cloud = world_of_boxes()
    assert describe(cloud, method) == describe(cloud.copy(), method)


@pytest.mark.parametrize("method", METHODS)
def test_points_that_are_not_finite_are_left_out(method: str) -> None:
    cloud = world_of_boxes()
    bad = np.array([[np.nan, 0, 0], [5, np.inf, 0], [5, 5, -np.inf]], dtype=np.float32)
    assert describe(np.concatenate([cloud, bad]), method) == describe(cloud, method)
    assert describe(bad, method) == Scene((), 0)


@pytest.mark.parametrize("method", METHODS)
def test_an_empty_cloud_is_an_empty_scene(method: str) -> None:
    assert describe(np.zeros((0, 3), dtype=np.float32), method) == Scene((), 0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_few_points_are_no_object(method: str, count: int) -> None:
    cloud = np.array([[5, 1, 0], [9, 2, 0], [5, 30, 1], [-7, 3, 2]], dtype=np.float32)[:count]
    assert describe(cloud, method).objects == ()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", [(3,), (4, 2), (4, 4), (2, 2, 3)])
def test_another_shape_is_refused(method: str, shape: tuple[int, ...]) -> None:
    with pytest.raises(ScanError, match=r"\(N, 3\)"):
        describe(np.zeros(shape, dtype=np.float32), method)


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(PerceptionError, match=r"'slow'.*fast.*reference"):
        describe(floor(), "slow")


@pytest.mark.parametrize("far", [119.9999, 120.0, 1e6, 3e38, -3e38])
def test_huge_coordinates_are_beyond_the_reach_of_fast(far: float) -> None:
    cloud = world_of_boxes()
    strays = np.array([[far, 0, 0], [0, far, 0], [0, far, far]], dtype=np.float32)
    assert describe(np.concatenate([cloud, strays]), "fast").objects == describe(cloud).objects


def test_a_stray_return_below_the_floor_leaves_the_floor_ground() -> None:
    stray = np.array([[6.1, 6.1, -SENSOR_HEIGHT - 2.0]], dtype=np.float32)
    assert describe(np.concatenate([floor(), stray])).objects == ()


def test_a_ceiling_does_not_join_what_stands_below_it() -> None:
    ceiling = floor() + np.array([0, 0, 6.0], np.float32)
    cloud = world_of_boxes()
    assert describe(np.concatenate([cloud, ceiling])).objects == describe(cloud).objects


def test_the_bottom_of_a_wide_object_without_ground_returns_is_no_ground() -> None:
    ground = floor()
    shadow = (np.abs(ground[:, :2] - [15, 0]) < 3).all(axis=1)
    (found,) = describe(np.concatenate([ground[~shadow], box((15, 0), (4, 4, 2))])).objects
    assert found.size[2] == pytest.approx(1.7, abs=0.3)


def test_ground_mask_marks_the_ground_of_the_given_cloud() -> None:
    cloud = world_of_boxes()
    cloud[5] = np.nan
    mask = ground_mask(cloud)
    expected = np.arange(len(cloud)) < len(floor())
    expected[5] = False
    np.testing.assert_array_equal(mask, expected)


@pytest.mark.parametrize("method", METHODS)
def test_a_segmentation_labels_points_that_are_not_ground(method: str) -> None:
    found: Segmentation = segment(world_of_boxes(), method)
    assert not found.ground[found.members].any()
    assert set(found.labels) == set(range(found.count))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_the_points_does_not_matter(seed: int) -> None:
    cloud = world_of_boxes()
    shuffled = np.random.default_rng(seed).permutation(cloud)
    np.testing.assert_allclose(as_rows(describe(shuffled)), as_rows(describe(cloud)), rtol=1e-6)


@settings(max_examples=25, deadline=None)
@given(x=st.floats(-6, 6, width=32), y=st.floats(-6, 6, width=32))
def test_moving_the_scan_moves_the_centroids(x: float, y: float) -> None:
    cloud = world_of_boxes()
    moved = as_rows(describe(cloud + np.array([x, y, 0], np.float32), own_body_m=0.0))
    before = as_rows(describe(cloud, own_body_m=0.0))
    np.testing.assert_allclose(moved[:, :3] - before[:, :3], [[x, y, 0]] * 3, atol=1e-4)
    np.testing.assert_allclose(moved[:, 4:8], before[:, 4:8], atol=1e-4)


@settings(max_examples=50, deadline=None)
@given(
    values=st.lists(
        st.tuples(*[st.floats(width=32, allow_nan=True, allow_infinity=True)] * 3), max_size=40
    )
)
def test_any_cloud_has_a_finite_description(values: list[tuple[float, float, float]]) -> None:
    cloud = np.array(values, dtype=np.float32).reshape(-1, 3)
    scene = describe(cloud)
    assert np.isfinite(as_rows(scene)).all()
    assert sum(o.points for o in scene.objects) + scene.ground_points <= len(cloud)
