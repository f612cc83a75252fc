"""One fused frame of a world, and what counts of it."""

from __future__ import annotations

import numpy as np
import pytest

from perception.fusion.base import EncodeOptions, Fusion, Gathering
from perception.fusion.registry import make_fusion
from perception.tally import Tally
from perception.types import Boxes
from research.evaluation.sharing import RememberingFusion
from research.evaluation.uncoded import UncodedEarly
from swarm.errors import PerceptionError, WorldError
from swarm.geometry import Matrix, Points
from worlds.cooperative.fusing import SINGLE, Disturbance, fuse_frame
from worlds.cooperative.judging import judge, tallied
from worlds.factory.world import FactoryWorld

NOISY = Disturbance(pose_noise_m=0.4)
LATE = Disturbance(delay_s=0.5)


@pytest.fixture(scope="module")
def world() -> FactoryWorld:
    return FactoryWorld(robots=3, seed=1_000_000, rings=16)


class Spy(Fusion):
    """Late fusion that remembers what it was asked to encode."""

    name = "spy"

    def __init__(self) -> None:
        self._late = make_fusion("late", "factory")
        self.clouds: list[Points] = []
        self.options: list[EncodeOptions] = []

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        self.clouds.append(points)
        self.options.append(options)
        return self._late.encode(points, options)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        return self._late.begin(own, world_from_own)


def test_noise_moves_what_robots_believe_of_their_pose_and_repeats(world: FactoryWorld) -> None:
    poses = []
    for _ in range(2):
        spy = Spy()
        fuse_frame(world, 10, "R1", world.robots, spy, NOISY)
        poses.append([options.pose for options in spy.options])
    assert poses[0] == poses[1]
    for robot, pose in zip(("R2", "R3"), poses[0], strict=True):
        assert pose is not None
        assert 0.01 < pose.distance_to(world.pose(robot, 10)) < 2.0
        assert abs(pose.yaw - world.pose(robot, 10).yaw) < np.radians(2.0)


def test_delay_sends_older_scans_with_the_pose_of_their_time(world: FactoryWorld) -> None:
    spy = Spy()
    fuse_frame(world, 10, "R1", ["R2"], spy, LATE)
    np.testing.assert_array_equal(spy.clouds[-1], world.scan("R2", 5).points)
    assert spy.options[-1].pose == world.pose("R2", 5)
    # The frame before, from which the ego knows how things move.
    np.testing.assert_array_equal(spy.clouds[0], world.scan("R2", 2).points)
    fuse_frame(world, 2, "R1", ["R2"], spy, LATE)
    np.testing.assert_array_equal(spy.clouds[-1], world.scan("R2", 0).points)


def test_the_ego_alone_sends_nothing(world: FactoryWorld) -> None:
    alone = fuse_frame(world, 10, "R1", world.robots, SINGLE)
    assert alone.bytes == {}
    nobody = fuse_frame(world, 10, "R1", ["R1"], "late")
    np.testing.assert_allclose(nobody.boxes.centers[:5], alone.boxes.centers[:5], atol=1e-6)


def test_unknown_names_are_refused(world: FactoryWorld) -> None:
    with pytest.raises(WorldError, match="R9"):
        fuse_frame(world, 0, "R1", ["R9"], "late")
    with pytest.raises(PerceptionError, match="'magic' is not available; allowed: single, early"):
        tallied(world, "magic", "R1")


def test_uncoded_clouds_weigh_twelve_bytes_a_point_and_find_the_same(world: FactoryWorld) -> None:
    whole = fuse_frame(world, 10, "R1", world.robots, UncodedEarly("factory"))
    assert whole.bytes == {robot: 12 * len(world.scan(robot, 10).points) for robot in ("R2", "R3")}
    coded = fuse_frame(world, 10, "R1", world.robots, "early")
    apart = np.linalg.norm(whole.boxes.centers[:3, None] - coded.boxes.centers[None], axis=2).min(
        axis=1
    )
    assert apart.max() < 0.3


@pytest.mark.parametrize("algorithm", ["early", "late", "intermediate-sparse"])
@pytest.mark.parametrize("disturbance", [Disturbance(), NOISY, LATE])
def test_remembering_changes_no_result(
    world: FactoryWorld, algorithm: str, disturbance: Disturbance
) -> None:
    try:
        fusion = make_fusion(algorithm, "factory")
    except PerceptionError:
        pytest.skip(f"no weights for {algorithm}")
    plain = fuse_frame(world, 12, "R1", world.robots, fusion, disturbance)
    remembering = RememberingFusion(fusion)
    for robots in (world.robots[:2], world.robots):
        shared = fuse_frame(world, 12, "R1", robots, remembering, disturbance)
    assert shared.bytes == plain.bytes
    np.testing.assert_array_equal(shared.boxes.centers, plain.boxes.centers)


def test_only_seen_objects_near_the_ego_count(world: FactoryWorld) -> None:
    truth = world.ground_truth(10)
    found, counted = judge(world, 10, "R1", truth.boxes)
    assert 0 < len(found) <= len(counted) + 1
    seen = {
        identity
        for identity, points in zip(truth.ids, truth.visible_points, strict=True)
        if points >= 5
    }
    assert len(counted) <= len(seen - {"R1"})
    own = world.pose("R1", 10)
    assert np.hypot(*(counted.centers[:, :2] - [own.x, own.y]).T).min() > 0.5


def box(x: float, score: float, label: str) -> Boxes:
    return Boxes(
        np.array([[x, 0.0, 0.0]]),
        np.array([[2.0, 1.0, 1.0]]),
        np.zeros(1),
        np.array([score]),
        (label,),
    )


def test_frames_of_several_worlds_are_ranked_together() -> None:
    first, second = Tally(), Tally()
    first.add(box(0, 0.9, "robot"), box(0, 1, "robot"), [100])
    second.add(box(9, 0.95, "robot"), box(0, 1, "robot"), [300])
    first.take_up(second)
    precision = first.precision()
    # The false alarm of the second world outranks the hit of the first: 1/2 at half of the recall.
    assert precision.ap_50 == pytest.approx(0.25)
    assert first.precision(per_frame=True).ap_50 == pytest.approx(0.5)
    assert (precision.frames, precision.ground_truth) == (2, 2)
    assert precision.bytes_per_robot_frame == 200.0


def test_a_class_counts_only_boxes_of_that_name() -> None:
    tally = Tally()
    tally.add(box(0, 0.9, "robot"), box(0, 1, "person"), [])
    assert [*tally.classes()] == ["person"]
    assert tally.precision().ap_50 == 1.0
    assert tally.precision("person").ap_50 == 0.0
    assert tally.precision("person").ground_truth == 1
