"""What a swarm delivered, beside what the same choices bring without a network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from perception.fusion.registry import make_fusion
from perception.metrics import Match, match, precision_of
from perception.types import Boxes
from research.evaluation.live.played import COMPARED as JUDGED
from research.evaluation.live.played import Comparison, Machine, compare_played, this_machine
from research.evaluation.live.swarm import Recorded, boxes_of, evenly, told_of
from research.evaluation.windows.scenarios import Scenario
from swarm.messages import Detections
from worlds.base import World
from worlds.cooperative.corrected import Corrected
from worlds.cooperative.fusing import fuse_frame
from worlds.cooperative.judging import judge

COMPARED = 12
"""Frames that are fused again without a network, evenly spread."""
IOU = 0.7


@dataclass(frozen=True, slots=True)
class LiveRow:
    """One policy in one scenario on one link."""

    scenario: str
    policy: str
    link_bps: int
    robots: int
    frames_due: int
    """At the sensors' rate."""
    frames_fused: int
    frames_complete: int
    """With everyone who was asked."""
    delivered_ratio: float
    """Complete ones of those that were due: 1 would have met the sensors' rate."""
    latency_ms_p50: float | None
    latency_ms_p99: float | None
    algorithms: dict[str, int]
    frames_compared: int
    ap_70_live: float | None
    ap_70_offline: float | None
    bytes_live: float | None
    """Payloads a frame, of the compared ones."""
    bytes_offline: float | None
    played: Comparison
    """All fused frames, whoever is missing in them, beside what a played window predicts."""
    ap_70_told: float | None
    """As `played.ap_70_live`, of what the ego tells: what it remembers; None where no frame has
    tracks."""


def compare_live(
    scenario: Scenario,
    policy: str,
    link_bps: int,
    recorded: Recorded,
    machine: Machine | None = None,
) -> LiveRow:
    """Fuses some of the frames again, from the same robots' scans, and compares; plays the window
    on that machine, by default this one by the packaged model of compute.

    The frames that are compared had an answer of everyone who took part: which those are is the
    network's doing, what they hold is not.
    """
    world = scenario.open()
    frames = recorded.frames
    due = round(recorded.seconds * world.rate_hz)
    complete = [frame for frame in frames if not frame.missing]
    compared = evenly(complete, COMPARED)
    judged = evenly(frames, JUDGED)
    latency = [frame.latency_ms for frame in frames]
    p50, p99 = np.percentile(latency, [50, 99]).tolist() if latency else (None, None)
    found = [boxes_of(frame) for frame in compared]
    again = [_again(world, frame) for frame in compared]
    return LiveRow(
        scenario=scenario.name,
        policy=policy,
        link_bps=link_bps,
        robots=scenario.robots,
        frames_due=due,
        frames_fused=len(frames),
        frames_complete=len(complete),
        delivered_ratio=min(1.0, len(complete) / due),
        latency_ms_p50=p50,
        latency_ms_p99=p99,
        algorithms={
            name: sum(frame.algorithm == name for frame in frames)
            for name in sorted({frame.algorithm for frame in frames})
        },
        frames_compared=len(compared),
        ap_70_live=_precision(world, compared, found) if compared else None,
        ap_70_offline=_precision(world, compared, [boxes for boxes, _ in again])
        if compared
        else None,
        bytes_live=float(np.mean([sum(frame.bytes.values()) for frame in compared]))
        if compared
        else None,
        bytes_offline=float(np.mean([size for _, size in again])) if compared else None,
        played=compare_played(scenario, link_bps, recorded, machine or this_machine()),
        ap_70_told=_precision(world, judged, [told_of(frame) for frame in judged])
        if any(frame.tracks is not None for frame in judged)
        else None,
    )


def _again(world: World, frame: Detections) -> tuple[Boxes, int]:
    """The boxes and payload bytes of the same choice on the same frame without a network, with
    poses put right as the ego did."""
    number = frame.frame % world.frame_count
    fused = fuse_frame(
        world,
        number,
        frame.ego,
        frame.participants,
        frame.algorithm,
        forms=frame.forms,
        poses=Corrected(frame.corrections),
    )
    own = world.scan(frame.ego, number)
    forms = [frame.forms.get(robot, frame.algorithm) for robot in fused.bytes]
    asks = {
        form: make_fusion(form, world.detector).begin(own.points, own.pose.matrix()).ask().size()
        for form in {*forms}
    }
    return fused.boxes, sum(fused.bytes.values()) - sum(asks[form] for form in forms)


def _precision(world: World, frames: Sequence[Detections], found: Sequence[Boxes]) -> float:
    matches: list[Match] = []
    for frame, boxes in zip(frames, found, strict=True):
        number = frame.frame % world.frame_count
        matches.append(match(*judge(world, number, frame.ego, boxes), IOU))
    return precision_of(matches)
