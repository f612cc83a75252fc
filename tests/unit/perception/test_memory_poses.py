"""Memory of poses: errors that last are told better, others as one frame shows them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from perception.fusion.alignment import Estimate
from perception.fusion.base import Contribution, EncodeOptions
from perception.fusion.compensation import MotionCompensation, OwnScan
from perception.fusion.known import KnownRobot
from perception.fusion.registry import make_fusion
from perception.jumps import JUMP_M
from perception.memory.poses import AGAIN, FORGOTTEN_S, MOST_SENDERS, PoseMemory
from swarm.body import Body
from swarm.geometry import Matrix, Pose, invert
from worlds.cooperative.pose_errors import disturbed
from worlds.factory.world import FactoryWorld

Floats = NDArray[np.float64]

SHOWN_SD = np.array([0.01, 0.01, math.radians(0.035)])
"""What one frame's estimates are off by on a floor."""
COVARIANCE = np.diag(np.square([0.027, 0.027, math.radians(0.1)]))
"""What they tell of that."""
ERROR = np.array([0.22, -0.15, math.radians(0.3)])
RIGHT = np.zeros(3)
FRAMES = 60


def off(move: Floats, error: Floats) -> float:
    """How far what a sender sees 8 m around itself ends up from where it is, metres."""
    x, y, turn = move - error
    return float(np.hypot(np.hypot(x, y), 8.0 * turn))


class Swarm:
    """An ego at the origin that looks along `yaw`, and one sender 10 m ahead of it."""

    def __init__(self, seed: int = 0, yaw: float = 0.4) -> None:
        self.memory = PoseMemory()
        self.rng = np.random.default_rng(seed)
        self.own = Pose(0.0, 0.0, 0.0, yaw=yaw).matrix()
        self.sender = Pose(10.0, 3.0, 0.0, yaw=1.0).matrix()

    def frame(
        self,
        time_s: float,
        error: Floats,
        robot: str = "R2",
        sd: float = 1.0,
        late_s: float = 0.0,
    ) -> tuple[Floats, Floats]:
        """What the frame alone shows of this error, and what memory makes of it: moves (3,) in the
        world's axes."""
        move = error + sd * self.rng.normal(0.0, SHOWN_SD)
        yaw = math.atan2(self.own[1, 0], self.own[0, 0])
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]]
        # What is shown holds what poses usually err by.
        shown = Estimate(turn @ move, COVARIANCE, 10.0)
        found = self.memory.at(time_s, time_s + late_s, self.own).corrected(
            robot, invert(self.own) @ self.sender, shown
        )
        return move, move if found is None else self.as_move(found.correction)

    def as_move(self, correction: Matrix) -> Floats:
        """A correction in the ego's frame as a move."""
        moved = self.own @ correction @ invert(self.own)
        stands = self.sender[:, 3]
        x, y = (moved @ stands - stands)[:2]
        return np.array([x, y, math.atan2(moved[1, 0], moved[0, 0])])

    def drive(
        self, error_at: Callable[[int], Floats], frames: int = FRAMES, first: int = 0
    ) -> tuple[Floats, Floats]:
        """What is left of the errors in each frame (frames,): by the frame alone, and by memory."""
        left = []
        for number in range(first, first + frames):
            alone, known = self.frame(number / 10.0, error_at(number))
            left.append((off(alone, error_at(number)), off(known, error_at(number))))
        first_left, second_left = np.array(left).T
        return first_left, second_left


def drifting(number: int) -> Floats:
    """From one error to another in 5 s, and back."""
    return ERROR * math.cos(math.pi * number / 50.0)


@pytest.mark.parametrize("seed", range(5))
def test_an_error_that_lasts_is_told_better_with_every_frame(seed: int) -> None:
    alone, known = Swarm(seed).drive(lambda _: ERROR)
    assert known[20:].mean() < 0.8 * alone[20:].mean()


@pytest.mark.parametrize("seed", range(5))
def test_an_error_that_drifts_is_followed(seed: int) -> None:
    alone, known = Swarm(seed).drive(drifting)
    assert known[20:].mean() < alone[20:].mean() + 0.005


@pytest.mark.parametrize("seed", range(5))
def test_errors_that_are_anew_in_each_frame_are_not_smeared(seed: int) -> None:
    rng = np.random.default_rng([seed, 1])
    errors = rng.normal(0.0, [0.2, 0.2, math.radians(0.2)], (FRAMES, 3))
    alone, known = Swarm(seed).drive(lambda number: errors[number])
    assert known[20:].mean() < alone[20:].mean() + 0.005


@pytest.mark.parametrize("error", [RIGHT, ERROR], ids=["none", "fixed"])
def test_an_error_that_lasts_is_known_until_it_was_not_seen_for_a_second(error: Floats) -> None:
    swarm = Swarm()
    assert not swarm.memory.knows("R2", 0.0)
    swarm.drive(lambda _: error)
    last_s = (FRAMES - 1) / 10.0
    assert swarm.memory.knows("R2", last_s + 0.5)
    assert not swarm.memory.knows("R2", last_s + 1.1)
    assert not swarm.memory.knows("R3", last_s)


def test_known_robots_are_put_where_an_error_that_lasts_was_shown() -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    elsewhere = Pose(12.0, 7.0, 0.0, yaw=-0.5).matrix()
    body = Body(label="robot", size=(1.0, 0.6, 0.5), center=(0.0, 0.0, 0.0))
    known = [KnownRobot(name, body, elsewhere) for name in ("R2", "R3")]
    last_s = (FRAMES - 1) / 10.0
    one, other = swarm.memory.put_right(known, {}, last_s + 5.0, swarm.own)
    moved = one.here_from_sensor[:2, 3] - elsewhere[:2, 3]
    assert moved == pytest.approx(ERROR[:2], abs=0.02)
    assert (other.here_from_sensor == elsewhere).all()
    # What the frame itself shows counts before that.
    one, _ = swarm.memory.put_right(known, {"R2": np.eye(4)}, last_s + 5.1, swarm.own)
    assert (one.here_from_sensor == elsewhere).all()
    one, _ = swarm.memory.put_right(known, {}, last_s + FORGOTTEN_S + 1.0, swarm.own)
    assert (one.here_from_sensor == elsewhere).all()


@pytest.mark.parametrize("who", ["sender", "ego"])
def test_a_silent_robot_is_put_nowhere_else_after_a_jump(who: str) -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    body = Body(label="robot", size=(1.0, 0.6, 0.5), center=(0.0, 0.0, 0.0))
    last_s = (FRAMES - 1) / 10.0
    right, told, jumped = np.eye(4), [], np.eye(4)
    jumped[:2, 3] = 3.0, -2.0
    for number in range(1, 20):
        moved = jumped if number >= 10 else right
        stands = (moved if who == "sender" else right) @ swarm.sender
        own = (moved if who == "ego" else right) @ swarm.own
        known = (KnownRobot("R2", body, stands),)
        (one,) = swarm.memory.put_right(known, {}, last_s + number / 10.0, own)
        told.append(np.hypot(*(one.here_from_sensor - stands)[:2, 3]))
    assert told == pytest.approx([np.hypot(*ERROR[:2])] * 9 + [0.0] * 10, abs=0.02)


@pytest.mark.parametrize("other", [-ERROR, RIGHT], ids=["opposite", "none"])
def test_an_error_that_is_anew_is_not_known_until_it_has_lasted(other: Floats) -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    for number in range(FRAMES, FRAMES + AGAIN):
        swarm.frame(number / 10.0, other)
        assert not swarm.memory.knows("R2", number / 10.0)
    swarm.drive(lambda _: other, first=FRAMES + AGAIN)
    assert swarm.memory.knows("R2", 2 * FRAMES / 10.0)


def test_a_clock_that_is_put_back_leaves_nothing_known() -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    assert not swarm.memory.knows("R2", FRAMES / 10.0 - 5.0)


@pytest.mark.parametrize("seed", range(5))
def test_errors_that_are_anew_in_each_frame_are_never_known(seed: int) -> None:
    swarm, rng = Swarm(seed), np.random.default_rng([seed, 1])
    errors = rng.normal(0.0, [0.2, 0.2, math.radians(0.2)], (FRAMES, 3))
    for number in range(FRAMES):
        swarm.frame(number / 10.0, errors[number])
        assert not swarm.memory.knows("R2", number / 10.0)


@pytest.mark.parametrize("seed", range(5))
def test_a_pose_that_is_set_anew_is_believed_at_once(seed: int) -> None:
    swarm = Swarm(seed)
    swarm.drive(lambda _: ERROR)
    alone, known = swarm.drive(lambda _: -ERROR, first=FRAMES)
    assert known[:3].mean() < alone[:3].mean() + 0.05
    assert known[20:].mean() < 0.8 * alone[20:].mean()


@pytest.mark.parametrize("seed", range(5))
def test_a_right_pose_is_left_alone(seed: int) -> None:
    swarm = Swarm(seed)
    told = [swarm.frame(number / 10.0, RIGHT)[1] for number in range(FRAMES)]
    assert np.allclose(told[10:], 0.0)


def test_a_sender_that_vanishes_for_three_seconds_is_known_when_it_is_back() -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    _, known = swarm.frame(FRAMES / 10.0 + 3.0, ERROR, sd=0.0)
    weak = Estimate(np.zeros(3), np.diag(np.square([0.4, 0.4, math.radians(0.5)])), 0.0)
    later = swarm.memory.at(FRAMES / 10.0 + 3.0, FRAMES / 10.0 + 3.0, swarm.own)
    found = later.corrected("R2", invert(swarm.own) @ swarm.sender, weak)
    assert found is not None
    assert off(swarm.as_move(found.correction), ERROR) < 0.1
    assert off(known, ERROR) < 0.1


@pytest.mark.parametrize("heard", [False, True], ids=["silent", "shows nothing"])
def test_a_sender_of_which_nothing_was_shown_for_long_is_estimated_anew(heard: bool) -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    for second in range(round(FORGOTTEN_S) if heard else 0):
        now_s = FRAMES / 10.0 + second
        now = swarm.memory.at(now_s, now_s, swarm.own)
        now.corrected("R2", invert(swarm.own) @ swarm.sender, Estimate.nothing())
    then_s = FRAMES / 10.0 + FORGOTTEN_S + 1.0
    then = swarm.memory.at(then_s, then_s, swarm.own)
    shown = Estimate(RIGHT, COVARIANCE, 0.0)
    assert then.corrected("R2", invert(swarm.own) @ swarm.sender, shown) is None


@pytest.mark.parametrize("who", ["own", "sender"])
def test_what_was_known_is_dropped_when_a_pose_jumps(who: str) -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    moved = Pose(0.0, -(JUMP_M + 0.5), 0.0).matrix()
    setattr(swarm, who, moved @ getattr(swarm, who))
    now = swarm.memory.at(FRAMES / 10.0, FRAMES / 10.0, swarm.own)
    shown = Estimate(RIGHT, COVARIANCE, 0.0)
    assert now.corrected("R2", invert(swarm.own) @ swarm.sender, shown) is None


@pytest.mark.parametrize("moved", [Pose(0.0, -20.0, 0.0), Pose(0.0, -3.0, 0.0)])
def test_an_ego_that_jumps_forgets_those_too_who_send_later(moved: Pose) -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    swarm.own = moved.matrix() @ swarm.own
    swarm.frame(FRAMES / 10.0, ERROR, robot="R3")
    assert len(swarm.memory) == 1


def test_late_contributions_of_a_fast_ego_are_no_jump_of_it() -> None:
    # At 20 m/s robots are fused every half second, each second time with what was seen 0.3 s ago.
    swarm = Swarm(yaw=0.0)
    for number in range(0, FRAMES, 5):
        swarm.own = Pose(2.0 * number, 0.0, 0.0).matrix()
        late_s = 0.3 if number % 10 else 0.0
        swarm.frame(number / 10.0 - late_s, ERROR, robot=f"R{number}", late_s=late_s)
    assert len(swarm.memory) == FRAMES / 5


def test_a_clock_that_is_put_back_begins_anew() -> None:
    swarm = Swarm()
    swarm.drive(lambda _: ERROR)
    swarm.frame(-2.0 * FORGOTTEN_S, ERROR, robot="R3")
    assert len(swarm.memory) == 1


def test_memory_is_bounded_and_keeps_those_heard_last() -> None:
    swarm = Swarm()
    for number in range(3 * MOST_SENDERS):
        swarm.frame(0.0, ERROR, robot=f"R{number}")
    assert len(swarm.memory) == MOST_SENDERS


def test_an_ego_remembers_from_frame_to_frame() -> None:
    floor, memory = FactoryWorld(robots=2, seed=1_000_003), PoseMemory()
    motion, fusion = MotionCompensation("factory", poses=memory), make_fusion("late", "factory")
    for frame in range(40, 44):
        mine, theirs = floor.scan("R1", frame), floor.scan("R2", frame)
        claimed = disturbed(theirs.pose, "R2", frame, 0.2, "fixed", run=1)
        own = OwnScan(frame / 10.0, mine.points, mine.pose.matrix())
        gathering = motion.begin(fusion, own)
        payload = fusion.encode(theirs.points, EncodeOptions(pose=claimed))
        gathering.add(Contribution("R2", payload, claimed.matrix()))
        gathering.finish()
        (correction,) = gathering.corrections().values()
    right = correction @ claimed.matrix()
    assert np.hypot(*(right - theirs.pose.matrix())[:2, 3]) < 0.05
    assert np.hypot(claimed.x - theirs.pose.x, claimed.y - theirs.pose.y) > 0.1
    assert len(memory) == 1


def test_many_frames_that_show_a_little_are_not_taken_for_a_lot() -> None:
    swarm = Swarm()
    little = np.diag(np.square([0.1, 0.3, math.radians(0.5)]))
    for number in range(FRAMES):
        shown = Estimate(np.array([-0.3, -0.1, 0.0]), little, 1.0)
        frame = swarm.memory.at(number / 10.0, number / 10.0, swarm.own)
        found = frame.corrected("R2", invert(swarm.own) @ swarm.sender, shown)
        assert found is None or np.allclose(found.correction, np.eye(4))


@pytest.mark.parametrize("every", [5, 10])
def test_answers_without_an_outline_leave_what_is_known_as_it_is(every: int) -> None:
    swarm, left = Swarm(), []
    for number in range(FRAMES):
        if number % every == 0:
            swarm.frame(number / 10.0, ERROR)
            continue
        now = swarm.memory.at(number / 10.0, number / 10.0, swarm.own)
        found = now.corrected("R2", invert(swarm.own) @ swarm.sender, Estimate.nothing())
        move = RIGHT if found is None else swarm.as_move(found.correction)
        left.append(off(move, ERROR))
    assert max(left[2 * every :]) < 0.05
    assert left[0] < 0.05


def test_a_sender_of_which_nothing_was_shown_is_not_corrected() -> None:
    swarm = Swarm()
    now = swarm.memory.at(0.0, 0.0, swarm.own)
    found = now.corrected("R2", invert(swarm.own) @ swarm.sender, Estimate.nothing())
    assert found is None
    assert len(swarm.memory) == 0


def test_how_far_off_a_pose_may_be_is_told_and_nothing_of_an_error_that_lasts() -> None:
    swarm = Swarm()
    once = swarm.memory.at(0.0, 0.0, swarm.own)
    assert once.usual_m() is None
    swarm.drive(lambda _: ERROR)
    now = swarm.memory.at(FRAMES / 10.0, FRAMES / 10.0, swarm.own)
    found = now.corrected("R2", invert(swarm.own) @ swarm.sender, Estimate.nothing())
    assert found is not None
    assert found.left_m == 0.0
    shift_m = math.hypot(*swarm.as_move(found.correction)[:2])
    assert shift_m == pytest.approx(math.hypot(*ERROR[:2]), abs=0.05)


@pytest.mark.parametrize("error", [ERROR, RIGHT], ids=["off", "right"])
def test_by_how_much_poses_are_off_is_learnt_from_those_that_show_it(error: Floats) -> None:
    swarm = Swarm()
    swarm.drive(lambda _: error)
    wide = Estimate(np.zeros(3), COVARIANCE * 1e4, 0.0)
    now = swarm.memory.at(FRAMES / 10.0, FRAMES / 10.0, swarm.own)
    now.corrected("R3", invert(swarm.own) @ swarm.sender, wide)
    median_m = math.hypot(*error[:2])
    assert now.usual_m() == pytest.approx(median_m / math.sqrt(math.log(2.0)), abs=0.05)
