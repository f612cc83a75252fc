"""Ground, objects and ranges of sight are the same with their loops in C and without."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from perception.kernels import library
from perception.scene import describe, fast, ground_mask, segment, visibility, visible_range
from tests.support.codec_scans import room_scan

pytestmark = pytest.mark.skipif(
    library.places() is None, reason="perception was installed without a compiler"
)


def without_c(patch: pytest.MonkeyPatch) -> None:
    for module in (fast, visibility):
        patch.setattr(module, "places", lambda: None)


def hills() -> NDArray[np.float32]:
    """Points everywhere up to beyond the reach, on slopes, in pits and in the air."""
    rng = np.random.default_rng(7)
    flat = rng.uniform(-130.0, 130.0, (40_000, 2))
    z = 0.05 * flat[:, 0] + rng.choice(
        [0.0, 0.2, 1.5, 5.0, -3.0], len(flat), p=[0.6, 0.1, 0.2, 0.09, 0.01]
    )
    return np.column_stack([flat, z]).astype(np.float32)


def edges() -> NDArray[np.float32]:
    """Points in the outermost cells and on borders between cells and rays."""
    steps = np.array([-119.99899, -119.0, -0.4, -0.0, 0.0, 0.4, 60.0, 119.99899, 120.0])
    x, y, z = np.meshgrid(steps, steps, np.arange(8) * 0.2)
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()]).astype(np.float32)


CLOUDS = {
    "room": room_scan(32, 1024, seed=5),
    "hills": hills(),
    "edges": edges(),
    "one point": room_scan()[:1],
    "nothing": room_scan()[:0],
    "only ground": room_scan(32, 512)[room_scan(32, 512)[:, 2] < -1.7],
    "not contiguous": room_scan(16, 512, seed=8)[::3],
    "with gaps": np.where(
        np.arange(len(room_scan()))[:, None] % 7, room_scan(), np.float32(np.nan)
    ),
}


@pytest.mark.parametrize("points", CLOUDS.values(), ids=CLOUDS.keys())
def test_what_is_found_in_a_scan_is_the_same(
    points: NDArray[np.float32], monkeypatch: pytest.MonkeyPatch
) -> None:
    in_c, scene, mask = segment(points), describe(points), ground_mask(points)
    without_c(monkeypatch)
    in_numpy = segment(points)
    assert in_numpy.count == in_c.count
    for part in ("points", "ground", "members", "labels"):
        np.testing.assert_array_equal(getattr(in_numpy, part), getattr(in_c, part), strict=True)
    assert describe(points) == scene
    np.testing.assert_array_equal(ground_mask(points), mask)


@pytest.mark.parametrize("points", CLOUDS.values(), ids=CLOUDS.keys())
@pytest.mark.parametrize(("sectors", "yaw"), [(72, 0.0), (360, 2.9), (7, -40.0), (1, np.pi)])
def test_how_far_is_seen_is_the_same(
    points: NDArray[np.float32], sectors: int, yaw: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_c = visible_range(points, sectors, yaw)
    without_c(monkeypatch)
    np.testing.assert_array_equal(visible_range(points, sectors, yaw), in_c)


def test_the_ground_alone_is_that_of_the_whole_segmentation() -> None:
    points = hills()
    found = segment(points)
    mask = ground_mask(points)
    np.testing.assert_array_equal(points[mask], found.points[found.ground])
    assert 0.3 < mask.mean() < 0.9
