"""Correcting senders' poses by what both see."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from perception.fusion.alignment import STILL_M, align
from perception.fusion.landmarks import correct
from perception.fusion.maps import moved
from swarm.errors import PayloadError
from swarm.geometry import Matrix, Pose, invert

Floats = NDArray[np.float64]
SEEN = np.array([[5.0, 2.0], [-8.0, 6.0], [12.0, -9.0], [-3.0, -14.0], [20.0, 11.0]])
ONLY_MINE = np.array([[-18.0, 3.0], [2.0, 19.0]])
ONLY_THEIRS = np.array([[17.0, -2.0], [-11.0, -12.0], [9.0, 16.0]])


def misplaced(points: Floats, error: Matrix) -> Floats:
    """Where points are believed to be when the pose errs by `error`."""
    return points @ error[:2, :2].T + error[:2, 3]


def left_over(points: Floats, error: Matrix, corrected_from_claimed: Matrix) -> float:
    """How far points end up from where they are, on average, metres."""
    found = misplaced(misplaced(points, error), corrected_from_claimed)
    return float(np.linalg.norm(found - points, axis=1).mean())


@pytest.mark.parametrize("x", [-0.8, 0.3, 1.1])
@pytest.mark.parametrize("turn_deg", [-1.2, 0.0, 0.8])
def test_a_wrong_pose_is_corrected_by_what_both_see(x: float, turn_deg: float) -> None:
    error = Pose(x, 0.5, 0.0, yaw=np.radians(turn_deg)).matrix()
    mine = np.vstack([SEEN, ONLY_MINE])
    theirs = misplaced(np.vstack([ONLY_THEIRS, SEEN]), error)
    found = align(mine, theirs)
    assert found.together >= len(SEEN)
    assert left_over(SEEN, error, found.corrected_from_claimed) < 0.12


def test_one_common_object_corrects_the_place_and_leaves_the_heading() -> None:
    error = Pose(0.6, -0.4, 0.0).matrix()
    found = align(SEEN[:1], misplaced(SEEN[:1], error))
    assert found.together == 1
    assert left_over(SEEN[:1], error, found.corrected_from_claimed) < 0.1
    turn = np.arctan2(found.corrected_from_claimed[1, 0], found.corrected_from_claimed[0, 0])
    assert abs(turn) < np.radians(0.3)


def test_errors_within_the_landmarks_own_are_left_alone() -> None:
    noise = np.random.default_rng(1).normal(0.0, STILL_M / 3, SEEN.shape)
    assert np.array_equal(align(SEEN, SEEN + noise).corrected_from_claimed, np.eye(4))


@pytest.mark.parametrize(("mine", "theirs"), [(0, 0), (0, 3), (3, 0)])
def test_nothing_in_common_changes_nothing(mine: int, theirs: int) -> None:
    found = align(SEEN[:mine], SEEN[:theirs] + 30.0)
    assert np.array_equal(found.corrected_from_claimed, np.eye(4))
    assert found.together == 0


def test_a_sender_that_is_somewhere_else_is_refused() -> None:
    here = np.array([[5.0, 2.0], [-8.0, 6.0], [9.0, -9.0], [-3.0, -12.0]])
    there = np.array([[0.0, -3.0], [-12.0, -5.0], [3.0, 9.0], [12.0, 3.0]])
    with pytest.raises(PayloadError, match="does not align: none of its 4 objects"):
        align(here, there)


def test_sender_and_ego_that_see_each_other_need_no_third() -> None:
    truth = Pose(8.0, 3.0, 0.0, yaw=2.0).matrix()
    claimed = Pose(0.7, -0.3, 0.0).matrix() @ truth
    body = np.zeros(2)
    sees_me = (claimed @ invert(truth) @ [0.0, 0.0, 0.0, 1.0])[None, :2]
    i_see = truth[None, :2, 3]
    found = correct(i_see, sees_me, claimed, body).corrected_from_claimed
    assert np.linalg.norm((found @ claimed)[:2, 3] - truth[:2, 3]) < 0.1


def test_a_map_is_moved_by_whole_cells_without_loss() -> None:
    features = torch.rand(3, 20, 30)
    present = torch.rand(20, 30) > 0.5
    cell_m = 0.5
    shift = np.eye(4)
    shift[:2, 3] = (2 * cell_m, -3 * cell_m)
    there, here = moved(features, present, (30 * cell_m / 2, 20 * cell_m / 2), shift)
    assert torch.equal(here[:17, 2:], present[3:, :28])
    assert torch.allclose(
        there[:, :17, 2:] * here[:17, 2:], features[:, 3:, :28] * present[3:, :28], atol=1e-5
    )
    assert not there[:, ~here].any()


def test_a_turned_map_shows_its_peak_at_the_turned_place() -> None:
    features = torch.zeros(1, 60, 60)
    features[0, 30 + 12, 30 + 20] = 1.0
    present = torch.ones(60, 60, dtype=torch.bool)
    turn = Pose(0.0, 0.0, 0.0, yaw=np.radians(10.0)).matrix()
    there, _ = moved(features, present, (30.0, 30.0), turn)
    row, column = np.divmod(int(there[0].argmax()), 60)
    wanted = turn[:2, :2] @ [20.5, 12.5]
    assert np.hypot(column + 0.5 - 30 - wanted[0], row + 0.5 - 30 - wanted[1]) <= 0.8
