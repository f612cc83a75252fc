"""`coadapt eval live`: what a real swarm delivers is what the experiment says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from coadapt.main import main
from deploy.runtimes.netns import NetnsRuntime
from deploy.state import read_state
from ego_agent.knowledge.compute import ComputeModel, Work
from ego_agent.knowledge.pace import due
from perception.fusion.base import Contribution, EncodeOptions
from perception.fusion.mixed import Mixed, scored_by
from perception.fusion.publishing import publish
from perception.fusion.registry import make_fusion
from perception.types import Boxes
from research.evaluation.live.compare import compare_live
from research.evaluation.live.played import Comparison, Machine
from research.evaluation.live.run import agreement, live_suite, table
from research.evaluation.live.stretches import stretches
from research.evaluation.live.swarm import Recorded
from research.evaluation.windows import links
from research.evaluation.windows.scenarios import Scenario
from research.training.plans import TEST_SEEDS
from swarm.arrays import Array, pack
from swarm.messages import MIXED, Assignment, Decision, Detections, Tracks
from worlds.cooperative.fusing import fuse_frame, known_robots

QUICK, SLOW = (
    Machine(ComputeModel("made up", {"factory": {"intermediate": work, "single": work}}), 2)
    for work in (Work(1.0, 1.0, 0.0), Work(300.0, 1.0, 0.0))
)
SCENARIO = Scenario("live", 3, links.shift(), TEST_SEEDS.start + 555_558)


def packed(boxes: Boxes) -> Array:
    return pack(np.column_stack([boxes.centers, boxes.sizes, boxes.headings]).astype(np.float32))


def message(frame: int, boxes: Boxes, sizes: dict[str, int], **more: object) -> Detections:
    fields = {
        "ego": "R1",
        "cycle": 1,
        "frame": frame,
        "capture_ns": 0,
        "algorithm": "late",
        "participants": ("R1", *sizes),
        "boxes": packed(boxes),
        "scores": pack(boxes.scores.astype(np.float32).reshape(-1, 1)),
        "labels": boxes.labels,
        "bytes": sizes,
        "latency_ms": 40.0,
    }
    return Detections(**{**fields, **more})  # type: ignore[arg-type]


def delivered(frame: int) -> Detections:
    """What a swarm without any fault delivers of a frame."""
    fused = fuse_frame(SCENARIO.open(), frame, "R1", ["R2"], "late")
    return message(frame, fused.boxes, fused.bytes)


def test_a_faultless_swarm_agrees_with_the_experiment() -> None:
    frames = tuple(delivered(frame) for frame in (10, 11, 12))
    row = compare_live(SCENARIO, "static-late", 5_000_000, Recorded(0.5, frames))
    assert (row.frames_due, row.frames_fused, row.frames_complete) == (5, 3, 3)
    assert row.delivered_ratio == pytest.approx(0.6)
    assert row.ap_70_live == pytest.approx(row.ap_70_offline, abs=1e-6)
    assert row.bytes_live == row.bytes_offline
    assert row.algorithms == {"late": 3}
    assert agreement([row])["ap_70_agrees"]
    assert agreement([row])["bytes_agree"]


def test_what_was_lost_or_changed_on_the_way_shows() -> None:
    whole = delivered(10)
    fused = fuse_frame(SCENARIO.open(), 10, "R1", ["R2"], "late")
    nothing = message(11, Boxes.empty(), {"R2": 2 * fused.bytes["R2"]})
    cut = message(12, fused.boxes, fused.bytes, missing={"R3": "late"})
    row = compare_live(SCENARIO, "static-late", 5_000_000, Recorded(0.3, (whole, nothing, cut)))
    assert (row.frames_fused, row.frames_complete, row.frames_compared) == (3, 2, 2)
    found = agreement([row])
    assert not found["ap_70_agrees"]
    assert not found["bytes_agree"]


def test_a_swarm_that_delivers_nothing_has_no_precision() -> None:
    row = compare_live(SCENARIO, "static-late", 5_000_000, Recorded(1.0, ()))
    assert row.delivered_ratio == 0
    assert row.ap_70_live is row.bytes_live is row.latency_ms_p50 is None
    assert row.played == Comparison()
    assert not agreement([row])["delivered_ap_70_agrees"]
    assert not agreement([row])["bytes_agree"]


def answered(frame: int, asked: dict[str, str], **more: object) -> Detections:
    """What an ego makes of a frame for which each robot was asked in a form of its own."""
    world = SCENARIO.open()
    own = world.scan("R1", frame)
    fusions = {form: make_fusion(form, world.detector) for form in sorted({*asked.values()})}
    gathering = Mixed(fusions or {"late": make_fusion("late", world.detector)}).begin(
        own.points, own.pose.matrix()
    )
    sizes = {}
    for robot, form in asked.items():
        scan, ask = world.scan(robot, frame), gathering.ask_for(form)
        options = EncodeOptions(pose=scan.pose, reference=ask.reference, demand=ask.demand)
        payload = fusions[form].encode(scan.points, options)
        sizes[robot] = len(payload)
        gathering.add(Contribution(robot, payload, scan.pose.matrix(), form=form))
    scored_as = scored_by(asked.values()) if asked else "late"
    known = known_robots(world, frame, "R1")
    boxes = publish(gathering.finish(), world.detector, scored_as, len(asked), known)
    mixed = {"algorithm": MIXED, "forms": asked} if len(fusions) > 1 else {"algorithm": scored_as}
    return message(frame, boxes, sizes, **{**mixed, **more})


def test_a_frame_of_several_forms_agrees_with_the_experiment() -> None:
    asked = {"R2": "early", "R3": "late"}
    frames = tuple(answered(frame, asked) for frame in (10, 11, 12))
    row = compare_live(SCENARIO, "coverage", 5_000_000, Recorded(0.3, frames), QUICK)
    assert (row.algorithms, row.frames_compared) == ({MIXED: 3}, 3)
    assert row.ap_70_live == pytest.approx(row.ap_70_offline, abs=1e-6)
    assert row.bytes_live == row.bytes_offline
    assert row.played.ap_70_live == pytest.approx(row.played.ap_70_played, abs=1e-6)
    assert (row.played.in_time_live, row.played.in_time_played) == (1.0, 1.0)
    # Robots in the other's form are something else.
    forms = {"R2": "late", "R3": "early"}
    swapped = tuple(msgspec.structs.replace(frame, forms=forms) for frame in frames)
    other = compare_live(SCENARIO, "coverage", 5_000_000, Recorded(0.3, swapped), QUICK)
    assert other.bytes_live != other.bytes_offline
    assert other.ap_70_live != other.ap_70_offline


def in_turns() -> Decision:
    """R2 sends points in every other frame, R3 boxes in those between."""
    return msgspec.structs.replace(
        decision(1, ("R2", "R3"), None),
        algorithm=MIXED,
        assignments=(
            Assignment(robot="R2", algorithm="early", rate_hz=5.0),
            Assignment(robot="R3", algorithm="late", rate_hz=5.0),
        ),
    )


def in_turn(frame: int) -> Detections:
    decided = in_turns()
    asked = {one.robot: one.algorithm for one in decided.assignments}
    return answered(frame, {r: form for r, form in asked.items() if due(decided, r, frame)})


def test_robots_that_take_turns_are_in_time_when_each_came_in_its_own_frames() -> None:
    frames = tuple(in_turn(frame) for frame in (10, 11, 12, 13))
    assert [frame.participants for frame in frames] == 2 * [("R1", "R2"), ("R1", "R3")]
    recorded = Recorded(0.4, frames, (in_turns(),))
    row = compare_live(SCENARIO, "coverage", 5_000_000, recorded, QUICK)
    assert (row.frames_complete, row.algorithms) == (4, {"early": 2, "late": 2})
    assert row.ap_70_live == pytest.approx(row.ap_70_offline, abs=1e-6)
    assert row.bytes_live == row.bytes_offline
    assert (row.played.in_time_live, row.played.in_time_played) == (1.0, 1.0)
    assert (row.played.fused_live, row.played.fused_played) == (1.0, 1.0)
    assert row.played.ap_70_live == pytest.approx(row.played.ap_70_played, abs=1e-6)


def test_who_does_not_come_in_its_turn_is_not_in_time() -> None:
    alone = answered(11, {}, missing={"R3": "deadline"})
    recorded = Recorded(0.4, (in_turn(10), alone, in_turn(12), in_turn(13)), (in_turns(),))
    quick = compare_live(SCENARIO, "coverage", 5_000_000, recorded, QUICK).played
    assert (quick.in_time_live, quick.in_time_played) == (0.75, 1.0)
    slow = compare_live(SCENARIO, "coverage", 5_000_000, recorded, SLOW).played
    assert (slow.in_time_live, slow.in_time_played) == (0.75, 0.0)


def test_an_ego_that_skips_frames_asks_in_the_turns_of_those_that_it_fuses() -> None:
    frames = tuple(message(number, Boxes.empty(), {}) for number in (10, 12, 15))
    (part,) = stretches(Recorded(0.6, frames, (in_turns(),)), 10.0)
    assert (part.step, part.due) == (1, 6)
    assert [part.asked(frame.frame) for frame in frames] == [
        {"R2": "early"}, {"R2": "early"}, {"R3": "late"},
    ]  # fmt: skip
    # Turns go by fused frames: at 5 Hz every other frame of the sensors is one.
    every, other = in_turns().assignments
    rarer = msgspec.structs.replace(other, rate_hz=2.5)
    slower = msgspec.structs.replace(in_turns(), rate_hz=5.0, assignments=(every, rarer))
    frames = tuple(message(number, Boxes.empty(), {}) for number in (20, 22))
    (part,) = stretches(Recorded(0.4, frames, (slower,)), 10.0)
    assert [part.asked(frame.frame) for frame in frames] == [
        {"R2": "early", "R3": "late"}, {"R2": "early"},
    ]  # fmt: skip


def test_of_a_frame_whose_decision_was_not_heard_it_may_be_unknown_what_was_asked() -> None:
    forms = {"R2": "early", "R3": "late"}
    whole = message(10, Boxes.empty(), dict.fromkeys(forms, 9), algorithm=MIXED, forms=forms)
    part = message(
        11, Boxes.empty(), {"R2": 9}, algorithm=MIXED, forms={"R2": "early"}, missing={"R3": "busy"}
    )
    (told,) = stretches(Recorded(0.2, (whole, part)), 10.0)
    assert told.frames == (whole,)
    assert told.asked(10) == forms
    recorded = Recorded(0.2, (part,))
    assert compare_live(SCENARIO, "coverage", 5_000_000, recorded, QUICK).played == Comparison()


def test_what_an_ego_remembers_is_judged_beside_its_frames() -> None:
    seen = [delivered(frame) for frame in (10, 11, 12)]
    tracks = [
        Tracks(
            ids=tuple(range(len(frame.labels))),
            labels=frame.labels,
            boxes=frame.boxes,
            scores=frame.scores,
            velocities=pack(np.zeros((len(frame.labels), 2), dtype=np.float32)),
            ages_s=pack(np.zeros((len(frame.labels), 1), dtype=np.float32)),
        )
        for frame in seen
    ]
    frames = tuple(
        message(number, Boxes.empty(), {"R2": 9}, tracks=told)
        for number, told in zip((10, 11, 12), tracks, strict=True)
    )
    row = compare_live(SCENARIO, "static-late", 5_000_000, Recorded(0.3, frames), QUICK)
    assert (row.ap_70_live, row.played.ap_70_live) == (0.0, 0.0)
    plain = compare_live(SCENARIO, "static-late", 5_000_000, Recorded(0.3, tuple(seen)), QUICK)
    assert plain.ap_70_told is None
    assert row.ap_70_told == pytest.approx(plain.played.ap_70_live, abs=1e-6)
    head, _, told, nothing = (line.split("|") for line in table([row, plain]).splitlines())
    place = [one.strip() for one in head].index("told")
    assert told[place].strip() == f"{row.ap_70_told:.3f}"
    assert not nothing[place].strip()


def decision(cycle: int, participants: tuple[str, ...], deadline_s: float | None) -> Decision:
    return Decision(
        ego="R1", cycle=cycle, decided_ns=0, participants=("R1", *participants), algorithm="late",
        reason="", source="policy", policy="coverage", valid=True, deadline_s=deadline_s,
    )  # fmt: skip


def test_published_frames_belong_to_their_decisions() -> None:
    frames = tuple(
        message(number, Boxes.empty(), sizes, cycle=cycle, missing=missing)
        for number, cycle, sizes, missing in (
            (10, 1, {"R2": 9}, {"R3": "busy"}), (12, 2, {"R3": 9}, {}), (16, 2, {}, {}),
            (18, 3, {"R2": 9}, {}), (19, 4, {"R2": 9}, {}),
        )
    )  # fmt: skip
    decided = (decision(2, ("R2", "R3"), None), decision(3, ("R2",), 1.0))
    first, second, third = stretches(Recorded(1.0, frames, decided), 10.0)
    assert (first.robots, first.deadline_s) == (("R2", "R3"), 0.25)
    assert [frame.frame for frame in first.frames] == [10, 12, 16]
    assert (first.step, first.due) == (2, 4), "at half the sensors' rate, and one was skipped"
    assert (second.robots, second.deadline_s) == (("R2",), 1.0)
    assert (third.robots, third.deadline_s, third.due) == (("R2",), 0.25, 1)


def test_frames_without_a_robot_are_compared_with_what_a_played_window_predicts() -> None:
    alone = fuse_frame(SCENARIO.open(), 11, "R1", [], "late")
    whole, half = delivered(10), message(11, alone.boxes, {}, missing={"R2": "deadline"})
    recorded = Recorded(0.3, (whole, half, delivered(12)))
    quick = compare_live(SCENARIO, "static-late", 5_000_000, recorded, QUICK).played
    assert (quick.frames, quick.in_time_played, quick.fused_played) == (3, 1.0, 1.0)
    assert quick.in_time_live == pytest.approx(2 / 3)
    assert 2.0 < (quick.latency_ms_p50_played or 0) < 10.0, "2 ms of work, and a kilobyte"
    # A machine that takes longer to encode than a frame waits: the ego is always alone.
    slow = compare_live(SCENARIO, "static-late", 5_000_000, recorded, SLOW).played
    assert (slow.in_time_played, slow.fused_live) == (0.0, 1.0)
    assert slow.ap_70_live == quick.ap_70_live
    assert slow.ap_70_played != quick.ap_70_played
    both = replace(recorded, frames=(whole, delivered(11), delivered(12)))
    row = compare_live(SCENARIO, "static-late", 5_000_000, both, QUICK)
    assert row.played.ap_70_live == pytest.approx(row.played.ap_70_played, abs=1e-6)
    assert agreement([row])["delivered_ap_70_agrees"]


def test_the_live_suite_is_small_and_clean() -> None:
    assert [scenario.robots for scenario in live_suite()] == [3, 4]
    assert not any(scenario.pose_noise_m for scenario in live_suite())


def test_a_real_swarm_is_compared_and_gone_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if (why := NetnsRuntime().available()) is not None:
        pytest.skip(f"no network namespaces: {why}")
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path / "run"))
    # Few frames that wait long for everybody, so that some are complete on a busy machine, too.
    monkeypatch.setenv("COADAPT_FUSION_RATE_HZ", "2")
    monkeypatch.setenv("COADAPT_DEADLINE_S", "4")
    monkeypatch.setattr("research.evaluation.live.run.LINKS_BPS", (20_000_000,))
    monkeypatch.setattr("research.evaluation.live.run.ROBOTS", (3,))
    options = ["--policies", "static-late", "--seconds", "10", "--runtime", "netns"]
    assert main(["eval", "live", *options, "--output", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "live.json").read_text())
    (row,) = report["rows"]
    assert row["played"]["frames"] > 0
    assert row["frames_compared"] > 0
    assert row["ap_70_told"] is not None
    assert row["bytes_live"] == pytest.approx(row["bytes_offline"], rel=0.02)
    # Robots that a busy machine starves lag by a scan or two; of another world nothing would match.
    assert row["ap_70_live"] == pytest.approx(row["ap_70_offline"], abs=0.3)
    assert (tmp_path / "live.md").read_text().count("floor-3") == 1
    for path in (tmp_path / "run").glob("eval-*"):
        assert read_state(path.name) is None
