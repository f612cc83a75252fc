"""Execute: who is asked about the places of what is remembered, and when."""

from __future__ import annotations

import time
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

from ego_agent.execute.frame_fuser import FrameResult
from ego_agent.knowledge.pace import EVERYTHING
from perception.codec.places import within
from perception.fusion.alignment import Estimate
from perception.fusion.base import Contribution, Gathering
from perception.types import clean_points
from swarm.geometry import Matrix, Points, invert, transform
from swarm.messages import Assignment, Beacon, Observation, ObservationRequest
from swarm.session import Session
from tests.support.ego_hall import (  # noqa: F401
    Answer,
    CrateClouds,
    Crates,
    Ego,
    Hall,
    RobotStarter,
    a_hall,
    a_robot,
    a_swarm,
    decision,
    honest,
    observation,
)
from tests.support.ego_swarm import Swarm
from tests.support.message_samples import SAMPLES

WHOLE, PLACES = 0, 4
"""Numbers of frames, of ten, to which R2 sends a whole scan, and what is in places."""


class Focusing(Crates):
    """Crates, of which robots can tell place by place."""

    focuses = True

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        return Laid(own, world_from_own)


BEACON = next(sample for sample in SAMPLES if isinstance(sample, Beacon))
ERROR_M = 0.3


class Laid(CrateClouds):
    """Senders are laid over what the ego sees, and found to stand so far along its x from where
    they say."""

    def __init__(self, own: Points, world_from_own: Matrix) -> None:
        super().__init__(transform(world_from_own, clean_points(own)))
        self.own_from_world = invert(world_from_own)

    def add(self, contribution: Contribution) -> None:
        super().add(contribution)
        assert self.remembered is not None
        there = self.own_from_world @ contribution.world_from_sensor
        clear = np.diag(np.square([0.03, 0.03, 0.002]))
        shown = Estimate(np.array([ERROR_M, 0.0, 0.0]), clear, 100.0)
        self.remembered.corrected(contribution.robot, there, shown)


@pytest.fixture(name="ego")
def an_ego(swarm: Swarm, hall: Hall) -> Iterator[Ego]:
    with Session(swarm.address, "test", timeout_s=60) as session:
        yield Ego(session, hall, {"early": Focusing("early")})


def noting(answer: Answer, asked: list[ObservationRequest]) -> Answer:
    """The answer, which notes what was asked."""

    def noted(request: ObservationRequest) -> Observation:
        asked.append(request)
        return answer(request)

    return noted


SENDS = Assignment(robot="R2", algorithm="early", rate_hz=1.0, places_hz=5.0)
"""Once a second, with places in between."""


def fused(ego: Ego, number: int, sends: Assignment = SENDS) -> FrameResult:
    """The next frame of that number, of ten; what R2 sends in them."""
    wanted = msgspec.structs.replace(decision("R2"), assignments=(sends,))
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        own = ego.own()
        if own.frame % 10 == number:
            return ego.loop.fuse(wanted, own)
        time.sleep(0.02)
    raise AssertionError(f"no frame of number {number} came")


def fused_in_turn(ego: Ego) -> FrameResult:
    """A frame with a whole scan, and the next one about places, which what it showed still tells
    of; returns that of places."""
    while True:
        whole = fused(ego, WHOLE)
        places = fused(ego, PLACES)
        if places.own.frame < whole.own.frame + 10:
            return places


def test_who_has_sent_a_whole_scan_is_asked_about_the_places_of_what_it_showed(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    asked: list[ObservationRequest] = []
    robot("R2", noting(honest(hall, "R2"), asked))
    # Whether it stands where it says is not known yet.
    assert fused(ego, PLACES).round.questions == {}
    whole = fused(ego, WHOLE)
    assert (whole.participants, asked[-1].demand) == (("R1", "R2"), b"")
    size = ego.known.payload_sizes("R2", {}, time.time_ns())["early"]
    result = fused(ego, PLACES)
    assert result.participants == ("R1", "R2")
    assert result.round.focused(("R2",)) == {"R2"}
    # The crates of both, 5 m ahead of each, in the ego's frame.
    there = whole.boxes.centers - [*ego.own().world_from_sensor[:3, 3]]
    assert within(asked[-1].demand, there.astype("float32")).all()
    # It counts as what it is.
    assert ego.known.payload_sizes("R2", {}, time.time_ns()) == {"early": size}
    told = result.round.bytes["R2"] + len(asked[-1].demand)
    assert ego.known.focused_sizes("R2", time.time_ns()) == {"early": told}


def test_who_sends_objects_only_is_asked_so_and_counted_apart(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    asked: list[ObservationRequest] = []
    robot("R2", noting(honest(hall, "R2"), asked))
    sends = msgspec.structs.replace(SENDS, objects_only=True)
    # Nothing is remembered: who is asked sends everything.
    whole = fused(ego, WHOLE, sends)
    assert (asked[-1].demand, asked[-1].objects_only) == (b"", False)
    assert whole.round.objects_only(("R2",)) == frozenset()
    only, end = False, time.monotonic() + 30.0
    # The newest frame may be the one of before: time bounds the turns, not their number.
    while not only and time.monotonic() < end:
        size = ego.known.payload_sizes("R2", {}, time.time_ns())
        turn = fused(ego, WHOLE, sends)
        only = turn.own.frame // 10 % EVERYTHING != 0
        assert (asked[-1].demand, asked[-1].objects_only) == (b"", only)
        assert turn.round.objects_only(("R2",)) == ({"R2"} if only else frozenset())
        assert turn.round.focused(("R2",)) == frozenset()
    assert only
    now_ns = time.time_ns()
    assert ego.known.payload_sizes("R2", {}, now_ns) == size
    assert ego.known.object_sizes("R2", now_ns) == {"early": turn.round.bytes["R2"]}
    # It stands where it says: it is asked about places next.
    assert fused(ego, PLACES, sends).round.focused(("R2",)) == {"R2"}
    assert (bool(asked[-1].demand), asked[-1].objects_only) == (True, False)


def test_whose_pose_is_known_is_asked_about_places_without_an_outline(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    asked: list[ObservationRequest] = []
    robot("R2", noting(honest(hall, "R2"), asked))
    fused_in_turn(ego)
    found = [(bool(request.demand), request.without_outline) for request in asked]
    assert found[-2:] == [(False, False), (True, False)]
    for _ in range(8):
        ego.fuse("R2")
    fused_in_turn(ego)
    assert (bool(asked[-1].demand), asked[-1].without_outline) == (True, True)


def test_a_robot_is_shown_where_frames_before_have_put_it(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    robot("R2", honest(hall, "R2"))
    for _ in range(8):
        ego.fuse("R2")
    own = ego.own()
    beacon = msgspec.structs.replace(
        BEACON, robot="R2", pose=(9.0, 3.0, 1.2, 0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0),
        capture_ns=own.capture_ns, sent_ns=time.time_ns(), body=None,
    )  # fmt: skip
    ego.monitor.on_beacon(beacon)
    (known,) = ego.loop.fuse(decision(), own).known
    assert known.here_from_sensor[:2, 3] == pytest.approx([9.0 + ERROR_M, 3.0], abs=0.05)


def test_whose_whole_scan_is_refused_is_not_asked_about_places(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    broken = False

    def answer(request: ObservationRequest) -> Observation:
        if broken:
            return observation(hall, "R2", request, b"garbage")
        return honest(hall, "R2")(request)

    robot("R2", answer)
    assert fused(ego, WHOLE).participants == ("R1", "R2")
    assert fused(ego, PLACES).round.questions.keys() == {"R2"}
    broken = True
    assert fused(ego, WHOLE).missing["R2"].kind == "rejected"
    assert fused(ego, PLACES).round.questions == {}


def test_nobody_is_asked_where_nothing_is_remembered(
    ego: Ego, hall: Hall, robot: RobotStarter, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot("R2", honest(hall, "R2"))

    def fails(*_: object) -> None:
        raise ValueError("broken")

    monkeypatch.setattr("ego_agent.execute.frame_fuser.remember", fails)
    assert fused(ego, WHOLE).participants == ("R1", "R2")
    assert fused(ego, PLACES).round.questions == {}
