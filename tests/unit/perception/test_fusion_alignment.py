"""Correcting senders' poses by what both see."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from perception.fusion.aligner import Aligner, Held, in_world
from perception.fusion.alignment import MIN_GAIN, Field, correction, estimate
from perception.fusion.maps import moved
from perception.fusion.outline import SENT_POINTS, outline, standing, thinned
from swarm.errors import PayloadError
from swarm.geometry import Matrix, Points, Pose, invert
from worlds.cooperative.fusing import Disturbance, fuse_frame
from worlds.factory.world import FactoryWorld

Floats = NDArray[np.float64]
FLOOR = FactoryWorld(robots=4, seed=1_000_003)
FRAME = 40


def left_over(pose: Pose, claimed: Pose, ego: Pose, correction: Floats) -> float:
    """How far what a sender sees 10 m around itself ends up from where it is, metres."""
    ring = np.array([[10 * np.cos(a), 10 * np.sin(a), 0, 1] for a in np.linspace(0, 5, 6)]).T
    own_from_world = invert(ego.matrix())
    true = own_from_world @ pose.matrix() @ ring
    found = correction @ own_from_world @ claimed.matrix() @ ring
    return float(np.linalg.norm((found - true)[:2], axis=0).mean())


def align(field: Field, places: Floats, sender: Floats, min_gain: float = MIN_GAIN) -> Floats:
    """The correction of one sender by one field."""
    return correction(estimate(field, places, sender).told(min_gain), sender)


def correction_of(mine: Points, theirs: Points, own_from_sender: Floats) -> Floats:
    aligner = Aligner(mine)
    aligner.add(thinned(outline(theirs)), own_from_sender)
    (found,) = aligner.corrections()
    return found


def corrected(dx: float, dy: float, turn_deg: float, ego: str, sender: str) -> tuple[float, float]:
    """What is left of a pose error, before and after."""
    mine, theirs = FLOOR.scan(ego, FRAME), FLOOR.scan(sender, FRAME)
    pose = theirs.pose
    claimed = Pose(pose.x + dx, pose.y + dy, pose.z, yaw=pose.yaw + np.radians(turn_deg))
    own_from_sender = invert(mine.pose.matrix()) @ claimed.matrix()
    found = correction_of(mine.points, theirs.points, own_from_sender)
    return (
        left_over(pose, claimed, mine.pose, np.eye(4)),
        left_over(pose, claimed, mine.pose, found),
    )


@pytest.mark.parametrize(("dx", "dy"), [(0.5, 0.0), (-0.4, 0.6), (0.3, -0.3)])
@pytest.mark.parametrize("turn_deg", [-0.5, 0.0, 0.4])
def test_a_wrong_pose_is_corrected_by_what_both_see(dx: float, dy: float, turn_deg: float) -> None:
    before, after = corrected(dx, dy, turn_deg, "R1", "R2")
    assert before > 0.3
    assert after < 0.05


def test_a_sender_that_sees_other_things_is_laid_over_the_other_senders() -> None:
    # Two long corners; the ego sees the first, the middle sender both, the last the second.
    near = corner(0.0)
    far = corner(20.0)
    aligner = Aligner(upright(near))
    aligner.add(np.concatenate([near[::4], far[::4]]) - [15.0, 0.0], at(15.0, 0.0))
    aligner.add(far[1::4] + np.array([0.4 - 15.0, 0.3]), at(15.0, 0.0))
    first, second = aligner.corrections()
    assert np.array_equal(first, np.eye(4))
    assert second[:2, 3] == pytest.approx([-0.4, -0.3], abs=0.12)


def test_what_lies_beyond_the_ego_s_field_is_no_evidence() -> None:
    # The ego sees a wall at its edge; the sender one of the same shape far behind it.
    places = np.column_stack([np.full(101, 44.9), np.linspace(5.0, 15.0, 101)])
    field = Field.of(places)
    assert field.at(np.array([[100.0, 10.0], [44.9, 10.0]])) == pytest.approx([0.0, 1.0])
    theirs = np.column_stack([np.linspace(52.0, 95.0, 72), np.linspace(6.2, 16.2, 72)])
    assert np.array_equal(align(field, theirs, np.array([60.0, 0.0])), np.eye(4))


def test_what_the_ego_corrected_itself_stays_when_others_show_nothing_new() -> None:
    near = corner(0.0)
    aligner = Aligner(upright(near))
    aligner.add(near[::4] - [15.0, 0.0], at(15.0, 0.0))
    # Twelve places are the ego's corner: enough to be moved, too few to be settled.
    known = near[np.linspace(5, 195, 12).astype(int)] + np.array([0.4, 0.0])
    strange = np.random.default_rng(0).uniform(25.0, 40.0, (40, 2))
    aligner.add(np.concatenate([known, strange]) - [15.0, 0.0], at(15.0, 0.0))
    assert aligner.corrections()[1][:2, 3] == pytest.approx([-0.4, 0.0], abs=0.15)


def test_little_agreement_takes_more_evidence() -> None:
    near = corner(0.0)
    aligner = Aligner(upright(near))
    # As much evidence as moves a sender whose whole outline the ego sees.
    known = near[np.linspace(5, 195, 7).astype(int)] + np.array([0.4, 0.0])
    strange = np.random.default_rng(0).uniform(25.0, 40.0, (40, 2))
    places = np.concatenate([known, strange]) - [15.0, 0.0]
    field = Field.of(standing(upright(near)))
    there = places + np.array([15.0, 0.0])
    assert not np.array_equal(align(field, there, np.array([15.0, 0.0])), np.eye(4))
    aligner.add(places, at(15.0, 0.0))
    assert np.array_equal(aligner.corrections()[0], np.eye(4))


def test_corrections_that_were_found_before_count_whatever_the_frame_shows() -> None:
    near = corner(0.0)
    world_from_own = Pose(3.0, -2.0, 1.0, 0.0, 0.0, 0.7).matrix()
    found = Pose(0.4, 0.1, 0.0, 0.0, 0.0, 0.01).matrix()
    aligner = Aligner(upright(near))
    for robot in ("R2", "R3"):
        aligner.add(near[::4] - [15.0, 0.0], at(15.0, 0.0), robot)
    held, other = aligner.corrections(Held({"R2": found}, world_from_own))
    assert held == pytest.approx(invert(world_from_own) @ found @ world_from_own)
    assert other == pytest.approx(np.eye(4)), "this frame shows that it stands right"
    back = in_world(aligner, ["R2", "R3"], world_from_own)
    assert back["R2"] == pytest.approx(found)


def seen_by(near: Floats, off_m: float, *, strange: bool = True) -> Aligner:
    """Two senders that are off by so much and see what the ego sees, and one that sees other walls,
    if it is wanted."""
    aligner = Aligner(upright(near))
    for robot in ("R2", "R3"):
        aligner.add(near[::4] - [15.0, 0.0] + [off_m, 0.0], at(15.0, 0.0), robot)
    if strange:
        elsewhere = np.random.default_rng(0).uniform(25.0, 40.0, (60, 2))
        aligner.add(elsewhere - [15.0, 0.0], at(15.0, 0.0), "R4")
    aligner.corrections()
    return aligner


def test_who_shows_nothing_of_its_error_is_not_in_its_place_where_others_are_off() -> None:
    left = seen_by(corner(0.0), 0.4).unplaced()
    assert [*left] == [2]
    assert "may be off by 0.48 m, as others are by 0.48 m; allowed: 0.14" in left[2]


@pytest.mark.parametrize("off_m", [0.0, 0.05])
def test_it_is_believed_where_others_are_right(off_m: float) -> None:
    assert seen_by(corner(0.0), off_m).unplaced() == {}


def test_it_is_believed_where_nobody_shows_by_how_much_poses_are_off() -> None:
    aligner = Aligner(upright(corner(0.0)))
    elsewhere = np.random.default_rng(0).uniform(25.0, 40.0, (60, 2))
    for robot in ("R2", "R3"):
        aligner.add(elsewhere - [15.0, 0.0], at(15.0, 0.0), robot)
    aligner.corrections()
    assert aligner.unplaced() == {}


def test_whom_frames_before_have_put_right_is_in_its_place() -> None:
    near = corner(0.0)
    aligner = Aligner(upright(near))
    for robot in ("R2", "R3"):
        aligner.add(near[::4] - [15.0, 0.0] + [0.4, 0.0], at(15.0, 0.0), robot)
    aligner.add(np.zeros((0, 2)), at(20.0, 0.0), "R4")
    aligner.add(np.zeros((0, 2)), at(20.0, 0.0), "R5")
    aligner.corrections(Held({"R4": Pose(0.4, 0.0, 0.0).matrix()}, np.eye(4)))
    assert [*aligner.unplaced()] == [3]


@pytest.mark.parametrize("algorithm", ["early", "late", "intermediate-codebook"])
def test_a_frame_is_fused_as_if_whose_place_is_not_known_had_not_been_asked(
    algorithm: str,
) -> None:
    world, noise = FactoryWorld(robots=8, seed=1_000_008), Disturbance(pose_noise_m=0.4)
    fused = fuse_frame(world, FRAME, "R1", [*world.robots], algorithm, noise)
    assert 0 < len(fused.rejected) < 7, "this frame says nothing"
    others = [robot for robot in world.robots if robot not in fused.rejected]
    again = fuse_frame(world, FRAME, "R1", others, algorithm, noise)
    assert not again.rejected
    assert np.array_equal(fused.found.centers, again.found.centers)
    assert not fused.rejected.keys() & fused.sent_points.keys()


def test_a_sender_that_is_refused_takes_no_place() -> None:
    near = corner(0.0)
    aligner = Aligner(upright(near))
    with pytest.raises(PayloadError):
        aligner.add(near[::4] * 0.3 + np.array([3.0, 3.0]), at(1.0, 0.0))
    aligner.add(near[::4] - [15.0, 0.0], at(15.0, 0.0))
    assert len(aligner.corrections()) == 1


def corner(x: float) -> Floats:
    """Two walls, (N, 2)."""
    steps = np.linspace(0.0, 10.0, 101)
    walls = [np.column_stack([x + steps, np.full(101, 8.0)])]
    walls.append(np.column_stack([np.full(101, x + 5.0), steps - 12.0]))
    return np.concatenate(walls)


def upright(places: Floats) -> Points:
    """Points (M, 3) of walls over a floor."""
    walls = [np.column_stack([places, np.full(len(places), z)]) for z in np.linspace(-1, 1, 9)]
    x, y = np.meshgrid(np.linspace(-20, 30, 120), np.linspace(-20, 20, 120))
    floor = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -1.2)])
    return np.concatenate([*walls, floor]).astype(np.float32)


def at(x: float, y: float) -> Matrix:
    """A sender there that looks where the ego looks."""
    matrix = np.eye(4)
    matrix[:2, 3] = x, y
    return matrix


def test_a_right_pose_is_left_alone() -> None:
    for ego, sender in (("R1", "R2"), ("R3", "R1"), ("R4", "R2")):
        mine, theirs = FLOOR.scan(ego, FRAME), FLOOR.scan(sender, FRAME)
        own_from_sender = invert(mine.pose.matrix()) @ theirs.pose.matrix()
        found = correction_of(mine.points, theirs.points, own_from_sender)
        assert np.array_equal(found, np.eye(4))


@pytest.mark.parametrize(("mine", "theirs"), [(0, 0), (0, 40), (40, 0), (40, 39)])
def test_too_little_to_go_by_changes_nothing(mine: int, theirs: int) -> None:
    wall = np.column_stack([np.linspace(-10, 10, 40), np.full(40, 4.0)])
    found = align(Field.of(wall[:mine]), wall[:theirs] + 0.5, np.zeros(2))
    assert np.array_equal(found, np.eye(4))


def test_along_a_bare_wall_only_the_distance_to_it_is_corrected() -> None:
    wall = np.column_stack([np.linspace(-30, 30, 400), np.full(400, 4.0)])
    found = align(Field.of(wall), wall[150:250:2] + 0.4, np.zeros(2))
    assert found[1, 3] == pytest.approx(-0.4, abs=0.1)
    assert abs(found[0, 3]) < 0.1


def test_a_near_sender_that_is_somewhere_else_is_refused() -> None:
    mine, theirs = FLOOR.scan("R1", FRAME), FactoryWorld(robots=4, seed=9).scan("R3", FRAME)
    nowhere = Pose(6.0, 5.0, 0.0, yaw=0.7).matrix()
    with pytest.raises(PayloadError, match="does not align"):
        Aligner(mine.points).add(thinned(outline(theirs.points)) * 0.7, nowhere)


def test_an_outline_is_even_around_the_robot_and_has_no_ground() -> None:
    scan = FLOOR.scan("R2", FRAME)
    places = thinned(outline(scan.points))
    assert len(places) == SENT_POINTS
    distance = np.linalg.norm(places[:, None] - scan.points[None, :, :2], axis=2)
    high = scan.points[:, 2] > -1.1
    assert distance[:, high].min(axis=1).max() < 0.5
    angles = np.sort(np.arctan2(places[:, 1], places[:, 0]))
    assert np.diff(angles).max() < np.pi


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
