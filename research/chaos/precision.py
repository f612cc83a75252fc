"""How well a swarm saw through its faults, beside what its ego alone would have seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deploy.spec import SwarmSpec
from perception.metrics import Match, match, precision_of
from research.chaos.history import Seen
from research.evaluation.live.swarm import told_of
from swarm.messages import Detections
from worlds.cooperative.fusing import SINGLE, fuse_frame
from worlds.cooperative.judging import judge
from worlds.registry import open_world

COMPARED = 30
IOU = 0.7


def precision(spec: SwarmSpec, frames: Sequence[Detections]) -> Seen | None:
    """AP@0.7 of what was told with some of the frames, evenly spread, whoever is missing in them;
    None without any.

    Both count what `worlds.cooperative.judging.judge` lets count: robots do not.
    """
    if not frames:
        return None
    world = open_world(spec.world, robots=len(spec.robots), seed=spec.seed, rings=spec.rings)
    some = np.linspace(0, len(frames) - 1, min(COMPARED, len(frames))).astype(int)
    told: list[Match] = []
    alone: list[Match] = []
    for frame in (frames[i] for i in some):
        number = frame.frame % world.frame_count
        own = fuse_frame(world, number, frame.ego, (frame.ego,), SINGLE).boxes
        told.append(match(*judge(world, number, frame.ego, told_of(frame)), IOU))
        alone.append(match(*judge(world, number, frame.ego, own), IOU))
    return Seen(frames=len(some), ap_70=precision_of(told), ap_70_alone=precision_of(alone))
