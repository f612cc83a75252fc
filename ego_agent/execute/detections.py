"""A fused frame as the swarm hears of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ego_agent.execute.frame_fuser import FrameResult
from ego_agent.execute.pipeline import AskedFrame
from perception.fusion.alignment import move_of
from perception.fusion.known import KnownRobot
from perception.memory.memory import Remembered
from swarm import messages
from swarm.arrays import pack
from swarm.messages import MIXED, Algorithm, Detections
from swarm.messages.ego import MAX_NAMED

LEAST_MOVE = 1e-9
"""Metres or radians; what is less is a rounding error of the world's frame."""


def detections(ego: str, frame: AskedFrame, result: FrameResult, age_s: float) -> Detections:
    """The message of a frame that was asked for; `age_s`: since the ego's scan was captured."""
    decision, boxes, done = frame.decision, result.boxes, result.round
    helpers = result.participants[1:]
    table = np.column_stack([boxes.centers, boxes.sizes, boxes.headings]).astype(np.float32)
    return Detections(
        ego=ego,
        cycle=decision.cycle,
        frame=result.own.frame,
        capture_ns=result.own.capture_ns,
        algorithm=frame.algorithm,
        participants=result.participants,
        missing={robot: str(why) for robot, why in result.missing.items()},
        missing_kinds=result.missing_kinds(),
        known=tuple(_told(one, decision.doubted) for one in result.known[:MAX_NAMED]),
        boxes=pack(table),
        scores=pack(boxes.scores.astype(np.float32).reshape(-1, 1)),
        operating_point=result.operating_point,
        labels=boxes.labels,
        bytes=done.bytes,
        latency_ms=result.latency_ms,
        age_ms=max(0.0, age_s * 1e3),
        tracks=None if result.tracks is None else _tracks(result.tracks),
        forms=_forms(frame, result),
        ages_ms=_ages_ms(result),
        corrections=_corrections(result),
        focused=tuple(sorted(done.focused(helpers))),
        objects_only=tuple(sorted(done.objects_only(helpers))),
    )


def _forms(frame: AskedFrame, result: FrameResult) -> dict[str, Algorithm]:
    """What each participant has sent, where that differs."""
    if frame.algorithm != MIXED:
        return {}
    return {robot: frame.round.algorithm_of(robot) for robot in result.participants[1:]}


def _ages_ms(result: FrameResult) -> dict[str, float]:
    """How much older than the ego's scan each fused observation is, where it is of another time."""
    ages_ms = {one.robot: round(one.age_s * 1e3) for one in result.round.contributions}
    return {robot: ages_ms[robot] for robot in result.participants[1:] if ages_ms.get(robot)}


def _corrections(result: FrameResult) -> dict[str, tuple[float, float, float]]:
    """By what participants' poses were put right, where they were."""
    moves = {
        one.robot: move_of(by, one.world_from_sensor[:2, 3])
        for one in result.round.contributions
        if (by := result.corrections.get(one.robot)) is not None
    }
    return {robot: move for robot, move in moves.items() if max(map(abs, move)) > LEAST_MOVE}


def _tracks(told: Remembered) -> messages.Tracks:
    """What is remembered, as the swarm hears of it."""
    boxes = told.boxes
    table = np.column_stack([boxes.centers, boxes.sizes, boxes.headings]).astype(np.float32)
    return messages.Tracks(
        ids=tuple(told.ids.tolist()),
        labels=boxes.labels,
        boxes=pack(table),
        scores=pack(boxes.scores.astype(np.float32).reshape(-1, 1)),
        velocities=pack(told.velocities.astype(np.float32)),
        ages_s=pack(told.ages_s.astype(np.float32).reshape(-1, 1)),
    )


def _told(known: KnownRobot, doubts: Mapping[str, str]) -> messages.KnownRobot:
    """A known robot as the swarm hears of it."""
    box = known.box()
    x, y, z = box.centers[0].tolist()
    return messages.KnownRobot(
        robot=known.robot,
        label=known.body.label,
        center=(x, y, z),
        size=known.body.size,
        heading=float(box.headings[0]),
        age_s=known.age_s,
        velocity=known.velocity,
        doubt=doubts.get(known.robot, ""),
    )
