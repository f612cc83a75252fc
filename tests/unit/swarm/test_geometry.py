"""Rigid transforms: inverses, compositions and headings."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarm.geometry import TWO_PI, Pose, are_rotations, invert, transform, wrap_heading, yaw_of

metres = st.floats(-500, 500)
angles = st.floats(-20, 20)
poses = st.builds(Pose, metres, metres, metres, angles, angles, angles)
flat_poses = st.builds(Pose, metres, metres, metres, yaw=angles)
points = st.lists(st.tuples(metres, metres, metres), min_size=1, max_size=5).map(np.array)
# float32 keeps 24 bits: 6e-5 m at 1000 m, a few of which add up.
CLOSE_M = 2e-3


@given(poses)
def test_a_pose_is_a_rotation_and_an_offset(pose: Pose) -> None:
    matrix = pose.matrix()
    rotation = matrix[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert math.isclose(np.linalg.det(rotation), 1.0, abs_tol=1e-12)
    np.testing.assert_array_equal(matrix[:3, 3], [pose.x, pose.y, pose.z])


@given(poses)
def test_an_inverse_undoes_its_transform(pose: Pose) -> None:
    matrix = pose.matrix()
    np.testing.assert_allclose(invert(matrix) @ matrix, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(invert(invert(matrix)), matrix, atol=1e-9)


@given(poses, poses, points)
def test_transforming_twice_is_transforming_with_the_product(
    a: Pose, b: Pose, cloud: np.ndarray
) -> None:
    twice = transform(a.matrix(), transform(b.matrix(), cloud))
    once = transform(a.matrix() @ b.matrix(), cloud)
    np.testing.assert_allclose(twice, once, atol=CLOSE_M)


@given(poses, points)
def test_distances_survive_a_transform(pose: Pose, cloud: np.ndarray) -> None:
    moved = transform(pose.matrix(), cloud)
    before = np.linalg.norm(cloud - cloud[0], axis=1)
    after = np.linalg.norm(moved.astype(np.float64) - moved[0], axis=1)
    np.testing.assert_allclose(after, before, atol=CLOSE_M)


def test_axes_turn_as_right_hands_do() -> None:
    quarter = math.pi / 2
    x, y, z = np.eye(3, dtype=np.float32)[:, None, :]
    np.testing.assert_allclose(transform(Pose(0, 0, 0, yaw=quarter).matrix(), x), y, atol=1e-6)
    np.testing.assert_allclose(transform(Pose(0, 0, 0, roll=quarter).matrix(), y), z, atol=1e-6)
    np.testing.assert_allclose(transform(Pose(0, 0, 0, pitch=quarter).matrix(), x), -z, atol=1e-6)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_heading_lies_in_one_turn_and_points_the_same_way(angle: float) -> None:
    heading = wrap_heading(angle)
    assert 0.0 <= heading < TWO_PI
    if abs(angle) < 1e3:
        assert math.isclose(math.sin(heading), math.sin(angle), abs_tol=1e-9)
        assert math.isclose(math.cos(heading), math.cos(angle), abs_tol=1e-9)


@given(flat_poses)
def test_the_yaw_of_a_level_pose_is_its_heading(pose: Pose) -> None:
    difference = yaw_of(pose.matrix()) - pose.heading
    assert math.isclose(math.cos(difference), 1.0, abs_tol=1e-9)


@given(poses, poses)
def test_distance_is_seen_from_above_and_the_same_both_ways(a: Pose, b: Pose) -> None:
    assert a.distance_to(b) == b.distance_to(a)
    assert a.distance_to(Pose(a.x, a.y, b.z)) == 0.0


def test_rotations_are_told_from_what_scales_shears_mirrors_or_is_no_number() -> None:
    turned = Pose(0, 0, 0, 0.1, -0.2, 3.0).matrix()[:3, :3]
    shear, lost = turned.copy(), turned.copy()
    shear[0] += 0.1 * turned[1]
    lost[1, 1] = math.nan
    kinds = [turned, turned.round(4), 1.01 * turned, -turned, shear, lost, 0 * turned]
    assert are_rotations(np.array(kinds)).tolist() == [True, True] + [False] * 5
    assert bool(are_rotations(turned))
