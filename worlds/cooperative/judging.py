"""Scores what was fused of a world's frames against its ground truth."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from perception.boxes import iou_bev
from perception.fusion.base import Fusion
from perception.fusion.known import KnownRobot, bodies
from perception.fusion.registry import fusion_names
from perception.tally import Tally
from perception.types import Boxes
from swarm.errors import PerceptionError
from swarm.geometry import Matrix, invert
from worlds.base import GroundTruth, World
from worlds.cooperative.fusing import SINGLE, Disturbance, Fused, fuse_frame
from worlds.cooperative.remembering import remembered_frames

EVALUATION_RANGES_M = {"road": (140.0, 40.0), "factory": (25.0, 25.0)}
"""Boxes count within this of the ego along its own x and y, by detector: OPV2V's evaluation range,
and about the floor of six robots."""
MIN_VISIBLE_POINTS = 5
"""True boxes with fewer points in all scans together do not count, found or not."""
IGNORED_IOU = 0.3
"""A detected box that overlaps such a true box this much is neither right nor wrong."""


def tallied(
    world: World,
    algorithm: str | Fusion,
    ego: str,
    disturbance: Disturbance | None = None,
    frames: Sequence[int] | None = None,
    *,
    remembered: bool = False,
    rate_hz: float | None = None,
) -> Tally:
    """What one algorithm finds with all robots taking part, seen from one ego.

    Counts what `judge` lets count. `remembered`: what the ego tells from memory, frame after frame,
    where robots send `rate_hz` times a second (None: in every frame), in place of what is found in
    each frame by itself. Raises as `fuse_frame` and `remembered_frames` do.
    """
    allowed = (SINGLE, *fusion_names(world.detector))
    if isinstance(algorithm, str) and algorithm not in allowed:
        raise PerceptionError(
            f"algorithm {algorithm!r} is not available; allowed: {', '.join(allowed)}"
        )
    tally = Tally()
    if remembered:
        told = remembered_frames(world, algorithm, ego, disturbance, frames, rate_hz)
    else:
        told = (
            (frame, fuse_frame(world, frame, ego, world.robots, algorithm, disturbance))
            for frame in (range(world.frame_count) if frames is None else frames)
        )
    for frame, fused in told:
        add_frame(tally, world, frame, ego, fused)
    return tally


def add_frame(tally: Tally, world: World, frame: int, ego: str, fused: Fused) -> None:
    """Adds a fused frame: its objects, and beside them all that is known with the robots."""
    tally.add(
        *judge(world, frame, ego, fused.boxes),
        fused.bytes.values(),
        with_known=judge_with_known(world, frame, ego, fused.boxes, fused.known),
    )


def judge_with_known(
    world: World, frame: int, ego: str, boxes: Boxes, known: Sequence[KnownRobot]
) -> tuple[Boxes, Boxes]:
    """As `judge`, with known robots among what is found, and robots among what is true."""
    told = Boxes.concatenate([bodies(known), boxes])
    return judge(world, frame, ego, told, robots=True)


def judge(
    world: World, frame: int, ego: str, boxes: Boxes, *, robots: bool = False
) -> tuple[Boxes, Boxes]:
    """The detected and the true boxes that count, in the world frame.

    Those within EVALUATION_RANGES_M of the ego, without the ego itself, and true boxes with at
    least MIN_VISIBLE_POINTS points in all scans of the world together, whoever takes part. Robots
    do not count, as beacons tell where they are, unless `robots` says so. What is found of the
    other true boxes is left out, as KITTI does with its "don't care" regions.
    """
    reach = EVALUATION_RANGES_M[world.detector]
    own_from_world = invert(world.pose(ego, frame).matrix())
    told = {ego} if robots else {*world.robots}
    found, counted = _judged(boxes, world.ground_truth(frame), told)
    return _in_range(found, own_from_world, reach), _in_range(counted, own_from_world, reach)


def _judged(found: Boxes, truth: GroundTruth, told: Collection[str]) -> tuple[Boxes, Boxes]:
    """The detected and the true boxes that count; those of the names in `told` do not."""
    counts = truth.visible_points >= MIN_VISIBLE_POINTS
    counts &= np.array([identity not in told for identity in truth.ids], dtype=np.bool_)
    overlap = iou_bev(found, truth.boxes)
    ignored = overlap[:, ~counts].max(axis=1, initial=0.0)
    wanted = overlap[:, counts].max(axis=1, initial=0.0)
    kept = (ignored < IGNORED_IOU) | (wanted >= ignored)
    return found.take(kept), truth.boxes.take(counts)


def _in_range(boxes: Boxes, own_from_world: Matrix, reach_m: tuple[float, float]) -> Boxes:
    near = boxes.centers @ own_from_world[:3, :3].T + own_from_world[:3, 3]
    inside = np.flatnonzero((np.abs(near[:, :2]) <= reach_m).all(axis=1))
    return boxes.take(inside)
