"""What a frame's fusion with exactly these robots brought, whatever link they came over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from perception.fusion.base import Fusion
from perception.metrics import Match, match
from research.evaluation.windows.choice import Choice
from worlds.base import World
from worlds.cooperative.fusing import Disturbance, fuse_frame
from worlds.cooperative.judging import judge, judge_with_known

IOUS = (0.3, 0.5, 0.7)


@dataclass(frozen=True, slots=True)
class FusedFrame:
    """One fused frame against its true boxes."""

    matches: tuple[Match, ...]
    """By IOUS."""
    with_known: Match
    """The same at IoU 0.7 with the robots of which beacons tell."""
    bytes: Mapping[str, int]
    """Request and payload of each participant."""


FusedFrames = dict[tuple[int, Choice], FusedFrame]
"""By number of the frame in its world, and who took part."""


def fused_frame(
    world: World,
    frame: int,
    ego: str,
    participants: tuple[str, ...],
    fusion: str | Fusion,
    pose_noise_m: float,
) -> FusedFrame:
    """Fuses a frame. Raises what `fuse_frame` raises."""
    noise = Disturbance(pose_noise_m=pose_noise_m)
    fused = fuse_frame(world, frame, ego, participants, fusion, noise)
    found, truth = judge(world, frame, ego, fused.boxes)
    with_known = judge_with_known(world, frame, ego, fused.boxes, fused.known)
    return FusedFrame(
        tuple(match(found, truth, iou) for iou in IOUS),
        match(*with_known, IOUS[-1]),
        fused.bytes,
    )


def packed_frames(frames: FusedFrames) -> list[Any]:
    """What `unpacked_frames` restores, as plain values."""
    return [
        [
            frame, choice.participants, choice.algorithm, dict(one.bytes),
            [
                [m.scores.astype("<f8").tobytes(), m.hits.tobytes(), m.truths]
                for m in (*one.matches, one.with_known)
            ],
        ]
        for (frame, choice), one in frames.items()
    ]  # fmt: skip


def unpacked_frames(values: list[Any]) -> FusedFrames:
    """The frames whose `packed_frames` gave these values."""
    found = {}
    for frame, participants, algorithm, sizes, matches in values:
        *by_iou, with_known = (
            Match(np.frombuffer(scores, "<f8"), np.frombuffer(hits, np.bool_), truths)
            for scores, hits, truths in matches
        )
        choice = Choice(tuple(participants), algorithm)
        found[frame, choice] = FusedFrame(tuple(by_iou), with_known, sizes)
    return found
