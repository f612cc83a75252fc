"""Execute teaches: each answer, each missed deadline and each probe, on real sessions."""

from __future__ import annotations

import threading
import time

import msgspec

from ego_agent.knowledge.answers import AnswerTimes
from swarm.messages import Observation, ObservationRequest, Probe
from tests.support.ego_hall import (  # noqa: F401
    DEADLINE_S,
    Ego,
    Hall,
    RobotStarter,
    a_hall,
    a_robot,
    a_swarm,
    an_ego,
    decision,
    honest,
)
from tests.support.ego_swarm import until

SECOND_NS = 10**9


def answers_of(ego: Ego, robot: str, algorithm: str) -> AnswerTimes:
    return ego.known.experience.learnt().of(robot, [algorithm])[algorithm]


def test_a_probe_is_asked_once_beside_the_frame_teaches_and_is_not_fused(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    asked: list[str] = []

    def answer(request: ObservationRequest) -> Observation:
        asked.append(request.algorithm)
        return honest(hall, "R2")(request)

    robot("R2", answer)
    robot("R3", honest(hall, "R3"))
    probing = msgspec.structs.replace(
        decision("R2", "R3", algorithm="late"), probe=Probe(robot="R2", algorithm="early")
    )
    first = ego.loop.fuse(probing, ego.own())
    assert first.participants == ("R1", "R3")
    assert first.missing["R2"].kind == "probe"
    assert len(first.boxes) == 2
    until(lambda: _told(ego, "R2", "early"), "the probe's answer was taken up")
    assert answers_of(ego, "R2", "early").in_time(DEADLINE_S) == 1.0
    assert ("R2", "early") in ego.tally.take().received, "its bytes count"
    assert ego.loop.fuse(probing, ego.own()).participants == ("R1", "R2", "R3")
    assert asked == ["early", "late"]


def test_a_probe_waits_until_what_it_shows_is_recent_at_the_next_cycle(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    robot("R2", honest(hall, "R2"))
    probing = msgspec.structs.replace(decision(), probe=Probe(robot="R2", algorithm="early"))
    ego.loop._probe_after_s = 0.3
    ego.loop.follow(probing)
    ego.loop.fuse(probing, ego.own())
    assert not ego.loop._asker.waits
    time.sleep(0.3)
    ego.loop.fuse(probing, ego.own())
    until(lambda: _told(ego, "R2", "early"), "the probe's answer was taken up")


def _told(ego: Ego, robot: str, algorithm: str) -> bool:
    ego.loop._asker.attend(0.05)
    return ego.known.experience.last(robot, algorithm) is not None


def test_a_missed_deadline_teaches_at_once_and_the_late_answer_how_long_it_took(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    go_on = threading.Event()

    def answer(request: ObservationRequest) -> Observation:
        go_on.wait(DEADLINE_S)
        return honest(hall, "R2")(request)

    robot("R2", answer)
    hasty = msgspec.structs.replace(decision("R2"), deadline_s=0.1)
    result = ego.loop.fuse(hasty, ego.own())
    assert result.missing["R2"].kind == "deadline"
    known = answers_of(ego, "R2", "early")
    assert known.in_time(0.1) < 1.0
    assert known.in_time(0.2) == 1.0, "how long it takes is not known yet"
    go_on.set()
    until(lambda: _late(ego), "the late answer was taken up")
    assert answers_of(ego, "R2", "early").in_time(0.1) < known.in_time(0.1) + 1e-9


def _late(ego: Ego) -> bool:
    ego.loop._asker.attend(0.05)
    return ego.tally.take().late_answers > 0


def test_a_fused_frame_teaches_what_it_takes_the_ego(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    robot("R2", honest(hall, "R2"))
    assert ego.known.own_costs.frame_s("early", 1) == 0.0
    ego.fuse("R2")
    assert ego.known.own_costs.frame_s("early", 1) > 0.0


def test_an_answer_that_shows_another_moment_teaches_that_nothing_comes(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    def answer(request: ObservationRequest) -> Observation:
        return msgspec.structs.replace(
            honest(hall, "R2")(request), capture_ns=request.capture_ns - SECOND_NS
        )

    robot("R2", answer)
    assert ego.loop.fuse(decision("R2"), ego.own()).missing["R2"].kind == "skew"
    known = answers_of(ego, "R2", "early")
    assert known.lost == 1.0
    assert known.in_time(DEADLINE_S) < 0.5
    assert known.work_s is not None, "what it takes of the robot is known all the same"
