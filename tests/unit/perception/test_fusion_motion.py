"""Motion compensation: velocities from tracks; late contributions fused in their own time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.fusion.base import Contribution, EncodeOptions, FrameRequest, Fusion, Gathering
from perception.fusion.compensation import MotionCompensation, OwnScan
from perception.fusion.known import without_own
from perception.fusion.tracks import FORGOTTEN_S, Tracks
from perception.metrics import average_precision
from perception.types import Boxes
from swarm.errors import PayloadError, PerceptionError
from swarm.geometry import Matrix, Points, Pose, invert
from worlds.cooperative.fusing import SINGLE, Disturbance, fuse_frame
from worlds.cooperative.judging import judge
from worlds.factory.world import FactoryWorld


def boxes(*places: tuple[float, float], label: str = "robot", score: float = 0.9) -> Boxes:
    count = len(places)
    centers = np.array([(x, y, 0.6) for x, y in places]).reshape(-1, 3)
    return Boxes(
        centers=centers,
        sizes=np.tile([0.9, 0.6, 1.2], (count, 1)),
        headings=np.zeros(count),
        scores=np.full(count, score),
        labels=(label,) * count,
    )


class TestTracks:
    def test_a_first_sight_has_no_velocity(self) -> None:
        assert np.array_equal(Tracks(1.0).update(boxes((0, 0), (5, 5)), 0.0), np.zeros((2, 2)))

    @given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.05, 0.4))
    def test_a_steady_object_s_velocity_is_learnt(self, x: float, y: float, step_s: float) -> None:
        tracks = Tracks(1.0)
        for i in range(12):
            told = tracks.update(boxes((x * i * step_s, y * i * step_s)), i * step_s)
        assert told[0] == pytest.approx([x, y], abs=0.1)

    def test_objects_that_pass_each_other_keep_their_velocities(self) -> None:
        tracks = Tracks(1.0)
        for i in range(30):
            t = i / 10
            told = tracks.update(boxes((-1.5 + t, 0.0), (1.5 - t, 0.7)), t)
        assert told == pytest.approx(np.array([[1.0, 0.0], [-1.0, 0.0]]), abs=0.1)

    def test_labels_are_not_mixed_up(self) -> None:
        tracks = Tracks(1.0)
        tracks.update(boxes((0, 0)), 0.0)
        assert not tracks.update(boxes((0.1, 0), label="person"), 0.1).any()
        assert tracks.update(boxes((0.1, 0)), 0.2).any()

    def test_a_newcomer_does_not_shuffle_a_queue(self) -> None:
        # Each of three drives on, the fourth is not seen, and another comes from behind: had each
        # the box behind it, all would have one.
        tracks = Tracks(6.0)
        tracks.update(boxes(*[(6.0 * i, 0.0) for i in range(4)]), 0.0)
        told = tracks.update(boxes((-4.5, 0), (2.5, 0), (8.5, 0), (14.5, 0)), 0.3)
        assert told[1:, 0] == pytest.approx(np.full(3, 8.0), abs=0.5)
        assert not told[0].any()

    def test_a_jump_is_another_object(self) -> None:
        tracks = Tracks(1.0)
        tracks.update(boxes((0, 0)), 0.0)
        assert not tracks.update(boxes((4, 0)), 0.1).any()

    def test_older_boxes_learn_velocities_and_change_nothing(self) -> None:
        tracks = Tracks(1.0)
        for i in range(10):
            tracks.update(boxes((i / 10, 0)), i / 10)
        before = tracks.update(boxes((0.5, 0)), 0.5)
        assert before[0] == pytest.approx([1, 0], abs=0.1)
        assert np.array_equal(tracks.update(boxes((0.5, 0)), 0.5), before)

    def test_what_was_not_seen_for_long_is_forgotten(self) -> None:
        tracks = Tracks(1.0)
        for i in range(5):
            tracks.update(boxes((i / 10, 0)), i / 10)
        later = 0.4 + FORGOTTEN_S + 0.1
        assert not tracks.update(boxes((later, 0)), later).any()

    def test_the_older_of_two_ages_is_followed_too(self) -> None:
        tracks = Tracks(1.0)
        for i in range(20):
            now = i / 10
            tracks.update(boxes((-5, 0)), now - 0.1)
            told = tracks.update(boxes((5 + now - 0.3, 0)), now - 0.3)
        assert told[0] == pytest.approx([1, 0], abs=0.1)

    def test_doubtful_boxes_are_not_followed(self) -> None:
        tracks = Tracks(1.0)
        for i in range(10):
            told = tracks.update(boxes((i / 10, 0), score=0.05), i / 10)
        assert not told.any()

    def test_a_flood_of_boxes_leaves_the_best_followed(self) -> None:
        tracks = Tracks(1.0)
        rng = np.random.default_rng(0)
        for i in range(6):
            flood = boxes(*rng.uniform(50, 500, (1000, 2)).tolist(), score=0.3)
            sure = boxes((i / 10, 0))
            told = tracks.update(Boxes.concatenate([flood, sure]), i / 10)
        assert told[-1] == pytest.approx([1, 0], abs=0.25)
        assert (told[:-1] == 0).all(axis=1).sum() >= 800

    def test_nothing_seen_is_no_error(self) -> None:
        tracks = Tracks(1.0)
        tracks.update(Boxes.empty(), 0.0)
        tracks.update(boxes((0, 0)), 0.1)
        assert tracks.update(Boxes.empty(), 0.2).shape == (0, 2)


class Places(Fusion):
    """A fusion whose payload is one place on the floor, and which remembers what it was given."""

    name = "places"

    def __init__(self) -> None:
        self.begun: list[tuple[Points, Matrix]] = []

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        return b""

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        self.begun.append((own, world_from_own))
        return _Places(world_from_own)


class _Places(Gathering):
    def __init__(self, world_from_own: Matrix) -> None:
        self._world_from_own = world_from_own
        self._found: list[tuple[float, float]] = []

    def ask(self) -> FrameRequest:
        return FrameRequest()

    def add(self, contribution: Contribution) -> None:
        if not contribution.payload:
            raise PayloadError("empty")
        x, y = np.frombuffer(contribution.payload)
        self._found.append((float(x), float(y)))

    def finish(self) -> Boxes:
        found = boxes(*self._found).transformed(invert(self._world_from_own))
        return without_own(found, 0.6, self.stood_at).transformed(self._world_from_own)


def own_at(time_s: float, x: float = 0.0) -> OwnScan:
    nothing = np.zeros((1, 3), dtype=np.float32)
    return OwnScan(time_s, nothing, Pose(x, 0.0, 1.2).matrix())


def seen_at(x: float, y: float, age_s: float) -> Contribution:
    return Contribution("R2", np.array([x, y], dtype=np.float64).tobytes(), np.eye(4), age_s)


def test_timely_contributions_are_fused_as_without_compensation() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    motion.remember(own_at(0.9))
    gathering = motion.begin(fusion, own_at(1.0))
    gathering.add(seen_at(3, 4, 0.02))
    found = gathering.finish()
    assert found.centers[0, :2] == pytest.approx([3, 4])
    assert found.scores[0] == pytest.approx(0.9)
    assert len(fusion.begun) == 1


def test_a_lag_that_is_tolerated_takes_no_other_pass() -> None:
    motion, fusion = MotionCompensation("factory", timely_s=0.11), Places()
    motion.remember(own_at(0.9))
    gathering = motion.begin(fusion, own_at(1.0))
    gathering.add(seen_at(3, 4, 0.1))
    gathering.add(seen_at(6, 4, -0.1))
    assert len(gathering.finish()) == 2
    assert len(fusion.begun) == 1
    gathering.add(seen_at(9, 4, 0.12))
    assert len(fusion.begun) == 2


def test_a_late_contribution_is_moved_on_with_its_object() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    for i in range(20):
        now = i / 10
        gathering = motion.begin(fusion, own_at(now))
        # Captured 0.3 s ago, when the object was 0.3 m behind.
        gathering.add(seen_at(now - 0.3, 4, 0.3))
        found = gathering.finish()
    assert len(found) == 1
    assert found.centers[0, :2] == pytest.approx([1.9, 4], abs=0.03)


def test_late_contributions_meet_the_scan_of_their_time_in_the_frame_that_was_asked_for() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    for i in range(6):
        motion.remember(own_at(i / 10, x=i / 10))
    gathering = motion.begin(fusion, own_at(0.6, x=0.6))
    gathering.add(seen_at(5, 5, 0.31))
    points, world_from_own = fusion.begun[-1]
    assert world_from_own == pytest.approx(own_at(0.6, x=0.6).world_from_own)
    # Scanned at x = 0.3, told as from x = 0.6.
    assert points[0] == pytest.approx([-0.3, 0, 0], abs=1e-6)


def test_others_do_not_report_the_ego_where_it_was() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    motion.remember(own_at(0.5, x=0.0))
    gathering = motion.begin(fusion, own_at(1.0, x=1.5))
    gathering.add(seen_at(0.1, 0.0, 0.5))
    gathering.add(seen_at(6.0, 0.0, 0.5))
    assert gathering.finish().centers[:, 0] == pytest.approx([6.0])


def test_a_refused_late_contribution_leaves_no_trace() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    motion.remember(own_at(0.5))
    gathering = motion.begin(fusion, own_at(1.0))
    with pytest.raises(PayloadError):
        gathering.add(Contribution("R2", b"", np.eye(4), 0.5))
    gathering.add(seen_at(1, 2, 0.0))
    assert gathering.finish().scores == pytest.approx([0.9])


def test_a_clock_that_was_put_back_forgets_what_lies_in_the_future() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    for i in range(20):
        gathering = motion.begin(fusion, own_at(1000 + i / 10))
        gathering.add(seen_at(i / 10, 7, 0.0))
        gathering.finish()
    for i in range(20):
        # Now it stands still.
        gathering = motion.begin(fusion, own_at(1 + i / 10))
        gathering.add(seen_at(1.9, 7, 0.3 if i > 3 else 0.0))
        found = gathering.finish()
    assert found.centers[0, :2] == pytest.approx([1.9, 7], abs=0.02)


def test_scans_from_before_a_pose_was_set_anew_are_fused_with_nothing() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    for i in range(6):
        motion.remember(own_at(i / 10))
    gathering = motion.begin(fusion, own_at(0.6, x=3.0))
    gathering.add(seen_at(5, 5, 0.3))
    assert len(fusion.begun) == 1, "the scan of now"


@pytest.mark.parametrize("age_s", [3600.0, 0.9, -0.9])
def test_a_contribution_of_no_time_that_the_ego_knows_is_refused(age_s: float) -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    motion.remember(own_at(0.9))
    gathering = motion.begin(fusion, own_at(1.0))
    with pytest.raises(PayloadError, match=f"captured {age_s:.1f} s before"):
        gathering.add(seen_at(1, 2, age_s))
    assert len(gathering.finish()) == 0


def test_of_scans_as_near_the_newer_is_taken() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    for second in range(1, 30):
        motion.remember(own_at(second + 0.8))
        gathering = motion.begin(fusion, own_at(second + 1.0))
        gathering.add(seen_at(1, 2, 0.1))
    assert len(fusion.begun) == 29


def test_what_past_and_present_show_is_one_object_no_surer_than_each() -> None:
    motion, fusion = MotionCompensation("factory"), Places()
    motion.remember(own_at(0.5))
    gathering = motion.begin(fusion, own_at(1.0))
    gathering.add(seen_at(3.0, 4.0, 0.5))
    gathering.add(seen_at(3.0, 4.0, 0.5))
    gathering.add(seen_at(3.2, 4.0, 0.0))
    gathering.add(seen_at(8.0, 8.0, 0.0))
    found = gathering.finish()
    assert len(found) == 2
    assert 0.8 < found.scores.max() <= 0.9
    # More robots saw it there, but half a second ago.
    assert 3.05 < found.centers[0, 0] < 3.15
    assert found.centers[1, :2] == pytest.approx([8, 8])


def test_an_unknown_detector_is_named() -> None:
    with pytest.raises(PerceptionError, match="'sea'"):
        MotionCompensation("sea")


@pytest.mark.parametrize("algorithm", ["early", "late", "intermediate-codebook"])
def test_late_contributions_are_better_than_none(algorithm: str) -> None:
    pairs: dict[str, list[tuple[Boxes, Boxes]]] = {SINGLE: [], algorithm: []}
    for seed in range(3):
        world = FactoryWorld(robots=6, seed=1_000_300 + seed)
        ego, frame = world.robots[seed], 40 + seed
        for name, rows in pairs.items():
            fused = fuse_frame(world, frame, ego, world.robots, name, Disturbance(delay_s=0.3))
            assert not fused.rejected
            rows.append(judge(world, frame, ego, fused.boxes))
    alone, together = (average_precision(rows, 0.5) for rows in pairs.values())
    assert together > alone + 0.1
