"""When a robot publishes once for several egos, what, and for how long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.codec.outlined import take_outline
from perception.codec.points import decode_points
from perception.fusion.base import EncodeOptions
from perception.fusion.registry import make_fusion
from perception.types import Boxes
from robot_agent.sharing import INTEREST_S, MAX_SHARED_BYTES, PROMISE_S, TOO_DEAR_S, Sharing
from swarm.geometry import Points, Pose
from swarm.messages import ObservationRequest
from tests.support.robot_worlds import ChosenWorld, Robot

HERE = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def asks(ego: str, **changes: object) -> ObservationRequest:
    values: dict[str, object] = {
        "ego": ego,
        "request": 1,
        "algorithm": "early",
        "capture_ns": 0,
        "shares": True,
        "reference": HERE,
    }
    return ObservationRequest(**{**values, **changes})  # type: ignore[arg-type]


def sharing() -> Sharing:
    return Sharing(lambda name: name in ("early", "late"), 10.0)


def names(one: Sharing, frame: int, now: float) -> list[str]:
    return [name for name, _ in one.due(frame, now)]


def test_one_ego_is_answered_and_two_share() -> None:
    one = sharing()
    assert one.asked(asks("A"), 0.0) == 0.0
    assert one.asked(asks("A"), 0.1) == 0.0
    assert names(one, 1, 0.1) == []
    assert one.asked(asks("B"), 0.2) == PROMISE_S
    assert one.asked(asks("A"), 0.3) == PROMISE_S
    assert names(one, 1, 0.4) == ["early"]
    assert names(one, 1, 0.4 + PROMISE_S) == []


def test_an_ego_that_ends_takes_nothing_from_the_others() -> None:
    one = sharing()
    one.asked(asks("A"), 0.0)
    one.asked(asks("B"), 0.0)
    # A is dead; B goes on: what it was promised is kept, and then it is answered again.
    assert one.asked(asks("B"), INTEREST_S - 0.1) == PROMISE_S
    assert names(one, 1, INTEREST_S + 0.5) == ["early"]
    assert one.asked(asks("B"), INTEREST_S + 1.0) == 0.0
    assert names(one, 1, INTEREST_S - 0.1 + PROMISE_S) == []


@pytest.mark.parametrize(
    "other",
    [
        {"shares": False},
        {"algorithm": "intermediate"},
        {"max_error_m": 0.01},
        {"keep_ground": True},
    ],
)
def test_who_wants_another_form_is_answered(other: dict[str, object]) -> None:
    one = sharing()
    one.asked(asks("A", **{k: v for k, v in other.items() if k == "algorithm"}), 0.0)
    assert one.asked(asks("B", **other), 0.1) == 0.0


def test_frames_are_published_as_often_as_somebody_wants_them() -> None:
    one = sharing()
    one.asked(asks("A", rate_hz=5.0), 0.0)
    one.asked(asks("B", rate_hz=3.3), 0.0)
    assert [n for n in range(12) if names(one, n, 0.1)] == [0, 2, 3, 4, 6, 8, 9, 10]


def test_what_costs_more_than_it_saves_is_not_published_for_a_while() -> None:
    one = sharing()
    one.asked(asks("A"), 0.0)
    one.asked(asks("B"), 0.0)
    one.answered("early", 1000)
    assert one.published("early", 2001, 0.1)
    assert one.asked(asks("A"), 1.0) == 0.0
    one.asked(asks("B"), TOO_DEAR_S)
    assert one.asked(asks("A"), 1.1 + TOO_DEAR_S) == PROMISE_S
    # A third asker makes it worth it.
    other = sharing()
    for ego in ("A", "B", "C"):
        other.asked(asks(ego), 0.0)
    other.answered("early", 1000)
    assert other.published("early", 2001, 0.1)
    assert other.asked(asks("A"), 1.0) == PROMISE_S


@pytest.mark.parametrize(("size", "most"), [(MAX_SHARED_BYTES + 1, 1 << 20), (3000, 2999)])
def test_what_a_link_does_not_carry_is_answered_instead(size: int, most: int) -> None:
    one = sharing()
    one.asked(asks("A"), 0.0)
    one.asked(asks("B", max_bytes=most), 0.0)
    assert not one.published("early", size, 0.1)
    assert names(one, 1, 0.2) == []
    assert one.asked(asks("A"), 0.3) == 0.0


def test_a_frame_goes_out_once_and_those_who_listen_get_no_second_copy() -> None:
    robot = Robot(ChosenWorld())
    robot.sense()
    robot.agent.observe(asks("A"))
    answer = robot.agent.observe(asks("B"))
    assert answer.shared_s == PROMISE_S
    assert answer.payload
    (published,) = robot.agent.share()
    assert (published.robot, published.algorithm, published.request) == ("R1", "early", 0)
    assert published.capture_ns == answer.capture_ns
    assert published.payload
    assert robot.agent.share() == []
    renewed = robot.agent.observe(asks("B", listens=True))
    assert (renewed.shared_s, renewed.payload) == (PROMISE_S, b"")
    # Who says that it listens where nothing is published gets its answer.
    alone = robot.agent.observe(asks("C", listens=True, algorithm="late"))
    assert alone.payload


def test_all_egos_find_in_the_shared_form_what_each_would_have_got() -> None:
    fusion = make_fusion("early", "factory")
    noise = np.random.default_rng(1)
    cloud = noise.uniform((-60, -60, -0.5), (60, 60, 1.0), (4000, 3)).astype(np.float32)
    pose = Pose(3.0, -2.0, 0.5, yaw=0.4)
    egos = (Pose(-20.0, 0.0, 0.5, yaw=1.0), Pose(15.0, 10.0, 0.5, yaw=-2.0))
    base = EncodeOptions(pose=pose)

    def sent(options: EncodeOptions) -> set[tuple[float, ...]]:
        points = decode_points(take_outline(fusion.encode(cloud, options))[0])
        return {tuple(np.round(point, 1)) for point in points.tolist()}

    shared = sent(replace(base, egos=egos))
    for ego in egos:
        own = sent(replace(base, reference=ego))
        # Another set of points may be rounded otherwise by a step of the codec.
        assert len(own) > 100
        near = _nearest(own, shared)
        assert near.max() < 0.3
    assert len(shared) < len(sent(base))


def _nearest(points: set[tuple[float, ...]], others: set[tuple[float, ...]]) -> Points:
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(np.array(sorted(others))).query(np.array(sorted(points)))
    found: Points = distances
    return found


def test_boxes_are_the_same_for_everybody() -> None:
    fusion = make_fusion("late", "factory")
    cloud = np.zeros((0, 3), np.float32)
    pose = Pose(0.0, 0.0, 1.0)
    assert fusion.encode(cloud, EncodeOptions(pose=pose, egos=(pose,))) == fusion.encode(
        cloud, EncodeOptions(pose=pose, reference=Pose(5.0, 5.0, 1.0))
    )
    assert isinstance(fusion.begin(cloud, np.eye(4)).finish(), Boxes)
