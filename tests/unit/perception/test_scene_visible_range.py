from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from perception.scene import visible_range
from swarm.errors import PerceptionError, ScanError

Cloud = NDArray[np.float32]


def ring_floor(reach: float, height: float = -1.8) -> Cloud:
    """Ground returns of a spinning sensor: circles 1 m apart, a point every 0.5 degrees."""
    azimuth, radius = np.meshgrid(np.radians(np.arange(0.25, 360, 0.5)), np.arange(4, reach + 1))
    circles = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=-1)
    flat = circles.reshape(-1, 2)
    return np.column_stack([flat, np.full(len(flat), height)]).astype(np.float32)


def wall(radius: float, start_deg: float, stop_deg: float, height: float = -1.8) -> Cloud:
    azimuth, z = np.meshgrid(np.radians(np.arange(start_deg, stop_deg, 0.4)), np.arange(0, 2, 0.2))
    parts = [radius * np.cos(azimuth), radius * np.sin(azimuth), z + height]
    return np.stack([p.ravel() for p in parts], axis=1).astype(np.float32)


def test_open_floor_is_seen_as_far_as_it_returns() -> None:
    seen = visible_range(ring_floor(30), sectors=36)
    assert seen.dtype == np.float32
    assert seen.shape == (36,)
    np.testing.assert_allclose(seen, 30.0, atol=0.01)


def test_a_wall_ends_the_view_in_its_sectors_only() -> None:
    cloud = np.concatenate([ring_floor(30), wall(12.0, 40, 60)])
    seen = visible_range(cloud, sectors=36)
    np.testing.assert_allclose(seen[4:6], 12.0, atol=0.05)
    np.testing.assert_allclose(np.delete(seen, [3, 4, 5, 6]), 30.0, atol=0.05)


def test_half_a_sector_behind_a_wall_counts_by_area() -> None:
    cloud = np.concatenate([ring_floor(30), wall(12.0, 0, 90)])
    seen = visible_range(cloud, sectors=2)
    assert seen[0] == pytest.approx(math.sqrt((30**2 + 12**2) / 2), rel=0.02)
    assert seen[1] == pytest.approx(30.0, rel=0.02)


def test_sectors_follow_the_world_azimuth_when_the_heading_is_given() -> None:
    cloud = np.concatenate([ring_floor(30), wall(12.0, 40, 60)])
    own, world = visible_range(cloud, 36), visible_range(cloud, 36, yaw=math.radians(90.0))
    np.testing.assert_allclose(np.roll(own, 9)[13:15], world[13:15], atol=0.05)
    np.testing.assert_allclose(world[13:15], 12.0, atol=0.05)


def test_nothing_is_seen_where_nothing_returns() -> None:
    cloud = ring_floor(20)
    seen = visible_range(cloud[cloud[:, 1] > 0], sectors=4)
    np.testing.assert_allclose(seen, [20, 20, 0, 0], atol=0.05)
    assert not visible_range(np.zeros((0, 3), np.float32)).any()


def test_single_stray_points_do_not_end_the_view() -> None:
    stray = np.array([[8.0, 0.5, 0.0], [9.0, -4.0, -0.5]], dtype=np.float32)
    seen = visible_range(np.concatenate([ring_floor(30), stray]))
    np.testing.assert_allclose(seen, 30.0, atol=0.01)


def test_the_own_body_does_not_end_the_view() -> None:
    hood = wall(1.9, -20, 20, height=-1.4)
    seen = visible_range(np.concatenate([ring_floor(30), hood]))
    np.testing.assert_allclose(seen, 30.0, atol=0.01)


@pytest.mark.parametrize("sectors", [0, -1, 361])
def test_a_number_of_sectors_that_cannot_be_had_is_refused(sectors: int) -> None:
    with pytest.raises(PerceptionError, match="1 to 360"):
        visible_range(ring_floor(10), sectors=sectors)


def test_a_wrong_shape_is_refused() -> None:
    with pytest.raises(ScanError):
        visible_range(np.zeros((4, 2), np.float32))
