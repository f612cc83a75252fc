"""Execute: a frame is fused in time from whatever arrived, and what did not arrive is named."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from ego_agent.analyze.scene import analyze
from ego_agent.execute.frame_round import MISSING_KINDS, Missing
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.pace import due
from swarm import keyspace
from swarm.arrays import unpack_finite
from swarm.errors import PerceptionError
from swarm.messages import Assignment, Beacon, Detections, Observation, ObservationRequest
from swarm.process import capture_ns
from swarm.session import Session
from tests.support.ego_hall import (  # noqa: F401
    Ego,
    Hall,
    RobotStarter,
    Strays,
    a_hall,
    a_robot,
    a_swarm,
    an_ego,
    decision,
    honest,
    observation,
)
from tests.support.ego_swarm import MessageLog, Swarm, until
from tests.support.message_samples import SAMPLES
from worlds.base import Scan

BEACON = next(sample for sample in SAMPLES if isinstance(sample, Beacon))
SHORT_S = 2.0
"""For frames in which no robot answers."""


@pytest.mark.parametrize("algorithm", ["early", "late"])
def test_what_robots_send_is_fused_and_their_bytes_are_counted(
    ego: Ego, hall: Hall, robot: RobotStarter, algorithm: str
) -> None:
    robot("R2", honest(hall, "R2"))
    robot("R3", honest(hall, "R3"))
    alone = ego.fuse(algorithm=algorithm)
    result = ego.fuse("R2", "R3", algorithm=algorithm)
    assert result.participants == ("R1", "R2", "R3")
    assert result.missing == {}
    assert len(alone.boxes) == 1
    assert len(result.boxes) == 3
    assert sorted(round(float(y)) for y in result.boxes.centers[:, 1]) == [0, 10, 20]
    taken = ego.tally.take()
    assert taken.received == {(r, algorithm): n for r, n in result.round.bytes.items()}
    assert set(result.round.bytes) == {"R2", "R3"}


def test_what_a_robot_showed_is_remembered_when_it_says_nothing(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    robot("R2", honest(hall, "R2"))
    result = ego.fuse("R2")
    shown = result.tracks
    until(lambda: ego.sensor.newest() > result.own.frame, "the next frame")
    alone = ego.fuse()
    assert shown is not None
    assert alone.tracks is not None
    assert len(alone.boxes) == 1
    by_id = {int(i): float(y) for i, y in zip(shown.ids, shown.boxes.centers[:, 1], strict=True)}
    assert sorted(round(y) for y in by_id.values()) == [0, 10]
    remembered = {int(i): age for i, age in zip(alone.tracks.ids, alone.tracks.ages_s, strict=True)}
    assert remembered.keys() == by_id.keys()
    assert sorted(age > 0.0 for age in remembered.values()) == [False, True]


def test_a_memory_that_fails_costs_no_frame(ego: Ego, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ValueError("broken")

    monkeypatch.setattr("ego_agent.execute.frame_fuser.remember", fails)
    result = ego.fuse()
    assert len(result.boxes) == 1
    assert result.tracks is None


def test_without_a_router_the_ego_fuses_alone(hall: Hall, swarm: Swarm, ego: Ego) -> None:
    ego.loop._session = None
    result = ego.fuse("R2")
    assert len(result.boxes) == 1
    assert result.missing == {"R2": Missing("offline", "no router")}


def test_a_robot_that_left_is_not_waited_for(ego: Ego) -> None:
    result = ego.fuse("R2")
    assert result.missing["R2"].kind == "left"


def held(hall: Hall, go: threading.Event) -> Callable[[ObservationRequest], Observation]:
    """R2 as it answers once it may."""

    def slow(request: ObservationRequest) -> Observation:
        go.wait(60)
        return honest(hall, "R2")(request)

    return slow


def test_a_slow_robot_costs_the_deadline_once_and_its_late_bytes_count(
    ego: Ego, hall: Hall, robot: RobotStarter, monkeypatch: pytest.MonkeyPatch
) -> None:
    # However long the second frame takes, the answer to the first one is not too late to count.
    monkeypatch.setattr("ego_agent.execute.ask.LATE_S", 60.0)
    go = threading.Event()
    robot("R2", held(hall, go))
    robot("R3", honest(hall, "R3"))
    first = ego.fuse("R2", "R3")
    assert first.missing["R2"].kind == "deadline"
    assert first.participants == ("R1", "R3")
    second = ego.fuse("R2", "R3")
    assert second.missing["R2"].kind == "busy"
    ego.tally.take()
    go.set()

    def back() -> bool:
        return "R2" in ego.fuse("R2", "R3").participants

    until(back, "R2 takes part again")
    taken = ego.tally.take()
    assert taken.late_answers >= 1
    assert taken.received["R2", "early"] > 0


def test_what_comes_late_is_remembered(
    ego: Ego, hall: Hall, robot: RobotStarter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ego_agent.execute.ask.LATE_S", 60.0)
    go = threading.Event()
    ego.loop._deadline_s = SHORT_S
    robot("R2", held(hall, go))
    first = ego.fuse("R2")
    assert first.missing["R2"].kind == "deadline"
    assert first.tracks is not None
    assert [round(y) for y in first.tracks.boxes.centers[:, 1]] == [0]
    fuser = ego.loop._fuser
    assert fuser.catch_up() == 0
    go.set()

    def caught_up() -> bool:
        ego.loop._asker.attend(0.1)
        return fuser.catch_up() == 1

    until(caught_up, "the answer has come")
    assert fuser.catch_up() == 0, "it is taken up once"
    until(lambda: ego.sensor.newest() > first.own.frame, "the next frame")
    second = ego.fuse()
    assert second.tracks is not None
    where = dict(zip(second.tracks.boxes.centers[:, 1].round(), second.tracks.ages_s, strict=True))
    assert where.keys() == {0.0, 10.0}
    assert where[10.0] > 0.0, "nobody has shown it since"


def test_a_request_for_an_old_frame_is_not_sent_again(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    go = threading.Event()
    heard: list[int] = []

    def slow(request: ObservationRequest) -> Observation:
        heard.append(request.request)
        go.wait(60)
        return honest(hall, "R2")(request)

    def silent(request: ObservationRequest) -> Observation:
        go.wait(60)
        return honest(hall, "R3")(request)

    ego.loop._deadline_s = SHORT_S
    robot("R2", slow)
    robot("R3", silent)
    assert ego.fuse("R2").missing["R2"].kind == "deadline"
    # The first request runs out of time while the ego still waits for the next frame's robot.
    assert ego.fuse("R3").missing["R3"].kind == "deadline"
    go.set()
    until(lambda: "R2" in ego.fuse("R2").participants, "R2 takes part again")
    assert len(heard) == len(set(heard))


def test_a_robot_whose_queryable_comes_after_its_token_takes_part_as_soon_as_it_is_there(
    swarm: Swarm, ego: Ego, hall: Hall
) -> None:
    with Session(swarm.address, "test", timeout_s=60) as session:
        session.declare_alive("R2")
        until(lambda: ego.monitor.is_alive("R2"), "R2 is seen")
        assert ego.fuse("R2").missing["R2"].kind == "unanswered"
        session.serve(keyspace.observation("test", "R2"), ObservationRequest, honest(hall, "R2"))
        until(lambda: ego.fuse("R2").participants == ("R1", "R2"), "R2 takes part")


def test_a_refusal_is_named_with_its_reason(ego: Ego, robot: RobotStarter) -> None:
    def refuse(request: ObservationRequest) -> Observation:
        raise PerceptionError("no frame near that time")

    robot("R2", refuse)
    missing = ego.fuse("R2").missing["R2"]
    assert missing.kind == "refused"
    assert "no frame near that time" in missing.detail


@pytest.mark.parametrize("payload", [b"", b"garbage", bytes(range(256)) * 100])
@pytest.mark.parametrize("algorithm", ["early", "late"])
def test_a_payload_that_cannot_be_read_is_rejected_and_the_others_are_fused(
    ego: Ego, hall: Hall, robot: RobotStarter, payload: bytes, algorithm: str
) -> None:
    robot("R2", lambda request: observation(hall, "R2", request, payload))
    robot("R3", honest(hall, "R3"))
    result = ego.fuse("R2", "R3", algorithm=algorithm)
    assert result.missing["R2"].kind == "rejected"
    assert result.participants == ("R1", "R3")
    assert len(result.boxes) == 2
    assert ego.tally.take().received["R2", algorithm] == len(payload)


def test_what_has_no_place_is_left_out_with_why_and_that_is_learnt(
    swarm: Swarm, hall: Hall, robot: RobotStarter
) -> None:
    with Session(swarm.address, "test", timeout_s=60) as session:
        ego = Ego(session, hall, {"early": Strays("early")})
        robot("R2", honest(hall, "R2"))
        robot("R3", honest(hall, "R3"))
        until(lambda: ego.monitor.is_alive("R2") and ego.monitor.is_alive("R3"), "both are seen")
        for _ in range(5):
            result = ego.fuse("R2", "R3")
            assert result.missing["R2"] == Missing("unplaced", "R2 is somewhere")
            assert result.participants == ("R1", "R3")
            assert len(result.boxes) == 2
        assert ego.known.placing.share("R2") < 0.5
        assert ego.known.placing.share("R3") == 1.0


@pytest.mark.parametrize(
    ("kind", "lie"),
    [
        ("invalid", {"robot": "R3"}),
        ("invalid", {"request": 4711}),
        ("invalid", {"algorithm": "late"}),
        ("skew", {"capture_ns": 10**9}),
        ("invalid", {"pose": (float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0)}),
    ],
)
def test_an_answer_to_another_question_is_not_fused(
    ego: Ego, hall: Hall, robot: RobotStarter, kind: str, lie: dict[str, object]
) -> None:
    robot("R2", lambda request: observation(hall, "R2", request, b"", **lie))
    result = ego.fuse("R2")
    assert result.missing["R2"].kind == kind
    assert result.participants == ("R1",)
    assert len(result.boxes) == 1


def test_what_another_process_answers_in_a_robots_name_is_not_fused(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    # Whoever connected first is asked: the robot itself, started again, comes too late.
    robot("R2", lambda request: observation(hall, "R2", request, b"", instance=2))
    ego.monitor.on_beacon(msgspec.structs.replace(BEACON, robot="R2", instance=1))
    asked = [ego.fuse("R2") for _ in range(40)]
    assert {result.missing["R2"].kind for result in asked} == {"impostor"}
    assert {result.participants for result in asked} == {("R1",)}


def test_nothing_is_hidden_by_a_robot_that_is_doubted(ego: Ego) -> None:
    # It says to stand where the crate is.
    own = ego.own()
    liar = msgspec.structs.replace(
        BEACON, robot="R2", pose=(5.0, 0.0, 1.2, 0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0),
        capture_ns=own.capture_ns, sent_ns=time.time_ns(), body=None,
    )  # fmt: skip
    ego.monitor.on_beacon(liar)
    believed = ego.loop.fuse(decision(), own)
    assert [one.robot for one in believed.known] == ["R2"]
    assert len(believed.boxes) == 0
    doubting = msgspec.structs.replace(decision(), doubted={"R2": "2 robots see free ground"})
    doubted = ego.loop.fuse(doubting, ego.own())
    assert [one.robot for one in doubted.known] == ["R2"]
    assert len(doubted.boxes) == 1


def test_an_oversized_answer_is_dropped(ego: Ego, hall: Hall, robot: RobotStarter) -> None:
    robot("R2", lambda request: observation(hall, "R2", request, bytes(9 * 1024 * 1024)))
    result = ego.fuse("R2")
    assert result.missing["R2"].kind == "refused"
    assert len(result.boxes) == 1


def test_no_more_is_asked_for_than_the_link_carries_in_a_second(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    asked: list[int] = []

    def answer(request: ObservationRequest) -> Observation:
        asked.append(request.max_bytes)
        return honest(hall, "R2")(request)

    robot("R2", answer)
    ego.link.set_state(800_000.0, time.monotonic())
    ego.fuse("R2")
    assert asked == [100_000]


def test_nan_points_and_an_empty_cloud_are_scans_too(ego: Ego, hall: Hall) -> None:
    hall.points[::7] = np.nan
    assert len(ego.fuse().boxes) == 1
    hall.points = np.zeros((0, 3), np.float32)
    assert len(ego.fuse().boxes) == 0
    hall.points = np.full((50, 3), np.nan, np.float32)
    assert len(ego.fuse(algorithm="late").boxes) == 0


def test_an_own_scan_that_cannot_be_read_leaves_the_robots_eyes(
    ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    robot("R2", honest(Hall(), "R2"))
    hall.readable = False
    result = ego.fuse("R2")
    assert "disk is gone" in result.own.failure
    assert result.participants == ("R1", "R2")
    assert [round(float(y)) for y in result.boxes.centers[:, 1]] == [10]
    view = ego.monitor.snapshot(1, time.time_ns()).robots["R1"]
    assert view.beacon is not None
    ego.sensor.locate()
    unified = analyze(ego.monitor.snapshot(2, time.time_ns()), Knowledge())
    assert "R1" not in unified.excluded


def test_the_loop_publishes_a_result_for_every_frame_it_does_not_skip(
    swarm: Swarm, ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    robot("R2", honest(hall, "R2"))
    heard: MessageLog[Detections] = swarm.detections(swarm.session(), "R1")
    ego.loop.follow(decision("R2"))
    ego.loop.start()
    seen = [heard.until(lambda d: d.participants == ("R1", "R2")) for _ in range(5)]
    ego.loop.stop()
    frames = [d.frame for d in seen]
    assert frames == sorted(set(frames))
    tally = ego.tally.take()
    assert tally.fused >= 5
    assert tally.fused + tally.skipped >= frames[-1] - frames[0] + 1
    assert all(set(d.bytes) == {"R2"} for d in seen)
    tracks = [d.tracks for d in seen]
    assert all(one is not None and len(one.ids) == 2 for one in tracks)
    assert len({one.ids for one in tracks if one is not None}) <= 2  # likeliest first
    last = tracks[-1]
    assert last is not None
    assert unpack_finite(last.velocities, "velocities", 2) == pytest.approx(0.0, abs=0.1)
    assert unpack_finite(last.ages_s, "ages_s", 1).tolist() == [[0.0], [0.0]]
    assert sorted(unpack_finite(last.boxes, "boxes", 7)[:, 1].round()) == [0.0, 10.0]


def test_a_sensor_that_is_slower_makes_a_frame_of_each_scan_only(
    swarm: Swarm, ego: Ego, hall: Hall, robot: RobotStarter, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot("R2", honest(hall, "R2"))
    scan = hall.scan

    def every_other(name: str, frame: int) -> Scan:
        captured_ns = capture_ns(ego.epoch_ns, hall.rate_hz, frame - frame % 2)
        return replace(scan(name, frame), captured_ns=captured_ns)

    monkeypatch.setattr(hall, "scan", every_other)
    heard: MessageLog[Detections] = swarm.detections(swarm.session(), "R1")
    # Its turn comes in frames that have no scan of their own, too.
    turns = tuple(Assignment(robot=r, algorithm="early", rate_hz=5.0) for r in ("R0", "R2"))
    sometimes = msgspec.structs.replace(decision("R2"), assignments=turns)
    assert {due(sometimes, "R2", frame) for frame in range(0, 10, 2)} == {False}
    ego.loop.follow(sometimes)
    ego.loop.start()
    seen = [heard.until(lambda d: d.participants == ("R1", "R2")) for _ in range(4)]
    ego.loop.stop()
    times = [one.capture_ns for one in seen]
    assert times == sorted(set(times))


def test_who_is_assigned_a_lower_rate_is_asked_in_its_turn(
    swarm: Swarm, ego: Ego, hall: Hall, robot: RobotStarter
) -> None:
    robot("R2", honest(hall, "R2"))
    robot("R3", honest(hall, "R3"))
    heard: MessageLog[Detections] = swarm.detections(swarm.session(), "R1")
    rare = Assignment(robot="R3", algorithm="early", rate_hz=2.0)
    carried_out = msgspec.structs.replace(decision("R2", "R3"), assignments=(rare,))
    ego.loop.follow(carried_out)
    ego.loop.start()
    heard.until(lambda d: d.participants == ("R1", "R2", "R3"))
    after = heard.until(lambda d: d.participants == ("R1", "R2"))
    ego.loop.stop()
    for one in heard.all:
        asked = {*one.participants, *one.missing} - {"R1"}
        assert asked == {robot for robot in ("R2", "R3") if due(carried_out, robot, one.frame)}
    # What R3 showed is told of in its absence.
    assert after.tracks is not None
    assert len(after.labels) == 2
    assert len(after.tracks.ids) == 3
    ages = unpack_finite(after.tracks.ages_s, "ages_s", 1)[:, 0]
    assert sorted(age > 0.0 for age in ages) == [False, False, True]


def test_frames_that_there_is_no_time_for_are_skipped_and_counted(ego: Ego, hall: Hall) -> None:
    fast = hall.scan

    def slow_scan(robot: str, frame: int) -> Scan:
        threading.Event().wait(0.35)
        return fast(robot, frame)

    hall.scan = slow_scan  # type: ignore[method-assign]
    ego.loop.follow(decision())
    ego.loop.start()

    def three() -> bool:
        with ego.tally._lock:
            return ego.tally._current.fused >= 3

    until(three, "three frames")
    ego.loop.stop()
    assert ego.tally.take().skipped >= 4


def test_a_scan_that_always_fails_does_not_end_the_loop(ego: Ego, hall: Hall) -> None:
    def broken(robot: str, frame: int) -> Scan:
        raise RuntimeError("a fault in the world")

    good = hall.scan
    hall.scan = broken  # type: ignore[method-assign]
    ego.loop.follow(decision())
    ego.loop.start()
    until(lambda: ego.tally._current.failed >= 2, "two failed frames")
    hall.scan = good  # type: ignore[method-assign]
    until(lambda: ego.tally._current.fused >= 1, "a fused frame")
    ego.loop.stop()


def test_every_reason_has_a_kind_that_metrics_know(ego: Ego) -> None:
    assert ego.fuse("R9").missing["R9"].kind in MISSING_KINDS
