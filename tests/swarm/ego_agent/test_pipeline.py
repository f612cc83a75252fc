"""Frames overlap: the next one is asked for while this one is fused, none is asked for in vain."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import msgspec
import pytest

from ego_agent.execute.frame_round import FrameRound
from ego_agent.execute.pipeline import MAX_FRAMES, AskedFrame, Pipeline
from ego_agent.execute.sense import OwnFrame
from perception.types import Boxes
from swarm.geometry import Pose
from swarm.messages import Detections, Observation, ObservationRequest
from tests.support.ego_hall import (  # noqa: F401
    CrateClouds,
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
from tests.support.ego_swarm import MessageLog, Swarm, until

WAIT_S = 60.0


@pytest.fixture
def running(ego: Ego) -> Iterator[Ego]:
    """The loop asks R2 and R3 for every frame; it is stopped at the end."""
    ego.loop.follow(decision("R2", "R3"))
    yield ego
    ego.loop.stop()


@pytest.fixture
def heard(swarm: Swarm) -> MessageLog[Detections]:
    return swarm.detections(swarm.session(), "R1")


class Hold:
    """Lets the fusing thread wait inside a frame, as a slow detector would."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.entered = threading.Event()
        self.go = threading.Event()
        finish = CrateClouds.finish

        def held(clouds: CrateClouds) -> Boxes:
            self.entered.set()
            assert self.go.wait(WAIT_S)
            return finish(clouds)

        monkeypatch.setattr(CrateClouds, "finish", held)


def test_the_next_frame_is_asked_for_while_this_one_is_fused(
    running: Ego, hall: Hall, robot: RobotStarter, monkeypatch: pytest.MonkeyPatch
) -> None:
    hold = Hold(monkeypatch)
    asked: list[int] = []

    def answer(request: ObservationRequest) -> Observation:
        asked.append(request.capture_ns)
        return honest(hall, "R2")(request)

    robot("R2", answer)
    running.loop.start()
    assert hold.entered.wait(WAIT_S)
    until(lambda: len(set(asked)) >= 2, "a second frame is asked for")
    assert running.tally.take().fused == 0
    hold.go.set()


def test_a_frame_that_is_skipped_is_skipped_before_anybody_is_asked(
    running: Ego,
    hall: Hall,
    robot: RobotStarter,
    heard: MessageLog[Detections],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hold = Hold(monkeypatch)
    asked: list[int] = []

    def answer(request: ObservationRequest) -> Observation:
        asked.append(request.capture_ns)
        return honest(hall, "R2")(request)

    robot("R2", answer)
    running.loop.start()
    assert hold.entered.wait(WAIT_S)
    first = running.sensor.newest()
    until(lambda: running.sensor.newest() >= first + 3 * MAX_FRAMES, "frames pass")
    under_way = set(asked)
    assert len(under_way) <= MAX_FRAMES
    hold.go.set()
    heard.until(lambda d: d.frame >= first + 3 * MAX_FRAMES)
    running.loop.stop()
    # Whatever was asked for was fused and published, and the frames between were nobody's work.
    until(
        lambda: set(asked) == {d.capture_ns for d in heard.all if "R2" in d.participants},
        "every frame that was asked for is published",
    )
    assert running.tally.take().skipped >= 2 * MAX_FRAMES


def test_frames_are_fused_in_their_order_though_answers_come_in_another(
    running: Ego, hall: Hall, robot: RobotStarter, heard: MessageLog[Detections]
) -> None:
    lock, order = threading.Lock(), []
    overtaken = threading.Event()

    def answer(request: ObservationRequest) -> Observation:
        with lock:
            order.append(request.capture_ns)
            turn = len(order)
        if turn == 3:
            # Two frames have shown that the robot keeps up; this one comes after the next one's.
            assert overtaken.wait(WAIT_S)
        if turn == 4:
            overtaken.set()
        return honest(hall, "R2")(request)

    robot("R2", answer)
    running.loop.start()
    until(lambda: sum("R2" in d.participants for d in heard.all) >= 6, "R2 takes part again")
    running.loop.stop()
    frames = [d.frame for d in heard.all]
    assert frames == sorted(set(frames))
    held = [d for d in heard.all if d.capture_ns == order[2]]
    assert [d.participants for d in held] == [("R1", "R2")]


def test_a_robot_that_is_ten_times_slower_takes_nothing_from_the_others(
    running: Ego,
    hall: Hall,
    robot: RobotStarter,
    heard: MessageLog[Detections],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # However long ten frames take here, the slow robot is not given up.
    monkeypatch.setattr("ego_agent.execute.ask.LATE_S", 60.0)
    changed = threading.Condition()
    asked = {"R2": 0, "R3": 0}

    def quick(request: ObservationRequest) -> Observation:
        with changed:
            asked["R2"] += 1
            changed.notify_all()
        return honest(hall, "R2")(request)

    def slow(request: ObservationRequest) -> Observation:
        with changed:
            asked["R3"] += 1
            later = asked["R2"] + 10
            changed.wait_for(lambda: asked["R2"] >= later, WAIT_S)
        return honest(hall, "R3")(request)

    running.loop._deadline_s = 2.0
    robot("R2", quick)
    robot("R3", slow)
    running.loop.start()
    until(lambda: asked["R3"] >= 4, "R3 is asked a fourth time")
    running.loop.stop()
    late = [d.missing_kinds["R3"] for d in heard.all if "R3" in d.missing]
    assert set(late) <= {"deadline", "busy"}
    # It costs its own part only: R2 is asked for ten frames each time, and is in all of them.
    assert asked["R2"] >= 30
    until(
        lambda: sum("R2" in d.participants for d in heard.all) == asked["R2"],
        "R2 is in every frame that it was asked for",
    )
    # Where the machine is busy, R2 may owe answers of its own, and is not asked meanwhile.
    without = [d.missing_kinds["R2"] for d in heard.all if "R2" in d.missing]
    assert set(without) <= {"busy"}
    assert len(without) < asked["R2"] / 4


def test_a_robot_that_is_late_is_not_asked_again_before_it_has_answered(
    running: Ego, hall: Hall, robot: RobotStarter, heard: MessageLog[Detections]
) -> None:
    go = threading.Event()
    asked: list[int] = []

    def slow(request: ObservationRequest) -> Observation:
        asked.append(request.capture_ns)
        assert go.wait(WAIT_S)
        return honest(hall, "R2")(request)

    running.loop._deadline_s = 0.3
    robot("R2", slow)
    running.loop.start()
    late = heard.until(lambda d: d.missing_kinds["R2"] == "deadline")
    heard.until(lambda d: d.frame > late.frame and d.missing_kinds["R2"] == "busy")
    assert len(asked) == 1
    go.set()
    heard.until(lambda d: "R2" in d.participants)


def test_the_loop_stops_after_the_frames_that_were_asked_for(
    running: Ego, hall: Hall, robot: RobotStarter, heard: MessageLog[Detections]
) -> None:
    go = threading.Event()
    asked: list[int] = []

    def answer(request: ObservationRequest) -> Observation:
        asked.append(request.capture_ns)
        assert go.wait(WAIT_S)
        return honest(hall, "R2")(request)

    robot("R2", answer)
    running.loop.start()
    until(lambda: len(asked) == 1, "a frame is under way")
    stopping = threading.Thread(target=running.loop.stop)
    stopping.start()
    until(running.loop._stop.is_set, "the loop is told to stop")
    go.set()
    stopping.join(WAIT_S)
    assert not stopping.is_alive()
    assert not any(thread.is_alive() for thread in running.loop._threads)
    fused = heard.until(lambda d: d.capture_ns == asked[0])
    assert fused.participants == ("R1", "R2")
    assert len(asked) == 1


def test_the_loop_stops_though_a_robot_never_answers(
    running: Ego, hall: Hall, robot: RobotStarter, heard: MessageLog[Detections]
) -> None:
    go, asked = threading.Event(), threading.Event()

    def silent(request: ObservationRequest) -> Observation:
        asked.set()
        go.wait(WAIT_S)
        return honest(hall, "R2")(request)

    running.loop._deadline_s = 0.3
    robot("R2", silent)
    running.loop.start()
    assert asked.wait(WAIT_S)
    running.loop.stop()
    assert not any(thread.is_alive() for thread in running.loop._threads)
    assert all(d.participants == ("R1",) for d in heard.all)
    go.set()


def test_a_slower_pace_does_not_go_back_to_an_earlier_frame(
    running: Ego, hall: Hall, robot: RobotStarter, heard: MessageLog[Detections]
) -> None:
    robot("R2", honest(hall, "R2"))
    every, fourth = decision("R2"), msgspec.structs.replace(decision("R2"), rate_hz=2.5)
    running.loop.follow(every)
    running.loop.start()
    for _ in range(3):
        # The last one before a multiple of four: the next frame of the slower pace is near.
        heard.until(lambda d: d.frame % 4 == 3)
        running.loop.follow(fourth)
        heard.until(lambda d: d.frame % 4 == 0)
        running.loop.follow(every)
    running.loop.stop()
    frames = [d.frame for d in heard.all]
    assert frames == sorted(set(frames))


def test_detections_tell_how_old_they_are(
    running: Ego, hall: Hall, robot: RobotStarter, heard: MessageLog[Detections]
) -> None:
    robot("R2", honest(hall, "R2"))
    running.loop.start()
    first = heard.until(lambda d: "R2" in d.participants)
    now_ns = time.time_ns()
    assert first.age_ms is not None
    assert first.latency_ms <= first.age_ms <= (now_ns - first.capture_ns) * 1e-6


def frame(begun_at: float, closed_at: float | None = None) -> AskedFrame:
    asked = FrameRound({}, begun_at, 1.0)
    asked.closed_at = closed_at
    nothing = Hall().points[:0]
    own = OwnFrame(0, 0, nothing, Pose(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "")
    hall = CrateClouds(nothing)
    return AskedFrame(decision(), own, "early", None, hall, asked)  # type: ignore[arg-type]


def test_an_empty_pipeline_takes_a_frame_at_once_and_a_full_one_none() -> None:
    pipeline, now = Pipeline(), time.monotonic()
    assert pipeline.full_for_s(now) <= 0.0
    for _ in range(MAX_FRAMES):
        assert pipeline.full_for_s(now) <= 0.0
        pipeline.put(frame(now))
    assert pipeline.full_for_s(now) == float("inf")
    assert pipeline.take() is not None
    pipeline.done()
    assert pipeline.full_for_s(now) <= 0.0


def test_a_frame_whose_answers_would_wait_for_their_turn_is_not_asked_for_yet() -> None:
    pipeline, now = Pipeline(), time.monotonic()
    pipeline.put(frame(now - 0.001, closed_at=now))
    assert pipeline.take() is not None
    threading.Event().wait(0.2)
    pipeline.done()
    now = time.monotonic()
    # Fusing takes much longer than answers do, and a frame that is answered waits for it.
    assert pipeline.full_for_s(now) <= 0.0
    pipeline.put(frame(now, closed_at=now))
    one = pipeline.full_for_s(now)
    pipeline.put(frame(now, closed_at=now))
    two = pipeline.full_for_s(now)
    assert 0.0 < one < two


def test_a_closed_pipeline_gives_what_it_holds_and_then_nothing() -> None:
    pipeline = Pipeline()
    first = frame(0.0)
    pipeline.put(first)
    pipeline.close()
    assert pipeline.take() is first
    pipeline.done()
    assert pipeline.take() is None


def test_there_is_time_for_what_came_late_only_before_the_next_answers_are_expected() -> None:
    pipeline, now = Pipeline(), time.monotonic()
    assert pipeline.has_time(now), "nobody waits"
    pipeline._answer_s, pipeline._fuse_s = 0.2, 0.05
    pipeline.put(frame(now, now))
    assert not pipeline.has_time(now), "its answers are there"
    pipeline.take()
    pipeline.put(frame(now))
    assert pipeline.has_time(now + 0.1)
    assert not pipeline.has_time(now + 0.16)
