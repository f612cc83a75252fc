"""Fuses single frames of a world as a swarm would, and scores the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evaluation.tally import Precision, Tally
from perception.boxes import iou_bev
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.compensation import MotionCompensation, OwnScan
from perception.fusion.detectors import shared_finder
from perception.fusion.registry import fusion_names, make_fusion
from perception.types import Boxes
from swarm.errors import PerceptionError, WorldError
from swarm.geometry import Matrix, Pose, invert
from worlds.base import GroundTruth, World

SINGLE = "single"
"""Not a fusion: the ego's own scan alone."""
EVALUATION_RANGES_M = {"road": (140.0, 40.0), "factory": (25.0, 25.0)}
"""Boxes count within this of the ego along its own x and y, by detector: OPV2V's evaluation range,
and about the floor of six robots."""
MIN_VISIBLE_POINTS = 5
"""True boxes with fewer points in all scans together do not count, found or not."""
HISTORY_FRAMES = 3
"""Where contributions come late, the ego has fused the frame this long before, too."""
IGNORED_IOU = 0.3
"""A detected box that overlaps such a true box this much is neither right nor wrong."""


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What real links and odometry do to a contribution."""

    pose_noise_m: float = 0.0
    """Standard deviation of x and y in metres, and of the heading in degrees."""
    delay_s: float = 0.0
    """How old a contribution is when the ego fuses it, rounded to whole frames; in the first
    frames it is the first one at most."""


@dataclass(frozen=True, slots=True)
class Fused:
    """One fused frame in the world frame, and the payload bytes of each contribution."""

    boxes: Boxes
    bytes: dict[str, int]
    rejected: dict[str, str]


def fuse_frame(
    world: World,
    frame: int,
    ego: str,
    participants: Sequence[str],
    algorithm: str | Fusion,
    disturbance: Disturbance | None = None,
) -> Fused:
    """Encodes the participants' scans, decodes and fuses them at the ego.

    `participants` may or may not hold the ego, which always takes part. Noise is drawn from
    (robot, frame) alone, so a run repeats exactly. Raises WorldError for an unknown robot and
    PerceptionError for an unknown algorithm.
    """
    disturbance = disturbance or Disturbance()
    senders = [robot for robot in dict.fromkeys(participants) if robot != ego]
    unknown = [robot for robot in (ego, *senders) if robot not in world.robots]
    if unknown:
        raise WorldError(
            f"robot {unknown[0]!r} is not in this world; it has {', '.join(world.robots)}"
        )
    if algorithm == SINGLE:
        scan = world.scan(ego, frame)
        boxes = shared_finder(world.detector).find(scan.points)
        return Fused(boxes.transformed(scan.pose.matrix()), {}, {})
    fusion = make_fusion(algorithm, world.detector) if isinstance(algorithm, str) else algorithm
    late = round(disturbance.delay_s * world.rate_hz)
    if not late:
        own = _own_scan(world, ego, frame)
        gathering = fusion.begin(own.points, own.world_from_own)
        return _gathered(gathering, fusion, world, senders, frame, frame, disturbance)
    # The ego knows how things move from its frames before.
    motion = MotionCompensation(world.detector)
    fused = Fused(Boxes.empty(), {}, {})
    times = [max(0, frame - HISTORY_FRAMES), frame]
    sent = [max(0, now - late) for now in times]
    for at in sorted({*times, *sent}):
        own = _own_scan(world, ego, at)
        if at not in times:
            motion.remember(own)
            continue
        gathering = motion.begin(fusion, own)
        captured = max(0, at - late)
        fused = _gathered(gathering, fusion, world, senders, at, captured, disturbance)
    return fused


def _gathered(
    gathering: Gathering,
    fusion: Fusion,
    world: World,
    senders: Sequence[str],
    frame: int,
    captured: int,
    disturbance: Disturbance,
) -> Fused:
    """The senders' contributions of the frame `captured`, fused by the ego in `frame`."""
    ask = gathering.ask()
    age_s = (frame - captured) / world.rate_hz
    sizes, rejected = {}, {}
    for robot in senders:
        scan = world.scan(robot, captured)
        pose = disturbed(scan.pose, robot, frame, disturbance.pose_noise_m)
        options = EncodeOptions(pose=pose, reference=ask.reference, demand=ask.demand)
        payload = fusion.encode(scan.points, options)
        sizes[robot] = len(payload) + ask.size()
        try:
            gathering.add(Contribution(robot, payload, pose.matrix(), age_s))
        except PerceptionError as error:
            rejected[robot] = str(error)
    return Fused(gathering.finish(), sizes, rejected)


def _own_scan(world: World, ego: str, frame: int) -> OwnScan:
    scan = world.scan(ego, frame)
    return OwnScan(frame / world.rate_hz, scan.points, scan.pose.matrix())


def evaluate(
    world: World,
    algorithm: str | Fusion,
    ego: str,
    disturbance: Disturbance | None = None,
    frames: Sequence[int] | None = None,
    *,
    per_frame: bool = False,
) -> Precision:
    """AP of one algorithm with all robots taking part, seen from one ego.

    Counts what `judge` lets count; `per_frame` ranks as OpenCOOD does (perception.metrics).
    """
    allowed = (SINGLE, *fusion_names(world.detector))
    if isinstance(algorithm, str) and algorithm not in allowed:
        raise PerceptionError(
            f"algorithm {algorithm!r} is not available; allowed: {', '.join(allowed)}"
        )
    tally = Tally()
    for frame in range(world.frame_count) if frames is None else frames:
        fused = fuse_frame(world, frame, ego, world.robots, algorithm, disturbance)
        tally.add(*judge(world, frame, ego, fused.boxes), fused.bytes.values())
    return tally.precision(per_frame=per_frame)


def judge(world: World, frame: int, ego: str, boxes: Boxes) -> tuple[Boxes, Boxes]:
    """The detected and the true boxes that count, in the world frame.

    Those within EVALUATION_RANGES_M of the ego, without the ego itself, and true boxes with at
    least MIN_VISIBLE_POINTS points in all scans of the world together, whoever takes part. What is
    found of the other true boxes is left out, as KITTI does with its "don't care" regions.
    """
    reach = EVALUATION_RANGES_M[world.detector]
    own_from_world = invert(world.pose(ego, frame).matrix())
    found, counted = _judged(boxes, world.ground_truth(frame), ego)
    return _in_range(found, own_from_world, reach), _in_range(counted, own_from_world, reach)


def _judged(found: Boxes, truth: GroundTruth, ego: str) -> tuple[Boxes, Boxes]:
    """The detected and the true boxes that count."""
    counts = truth.visible_points >= MIN_VISIBLE_POINTS
    counts &= np.array([identity != ego for identity in truth.ids], dtype=np.bool_)
    overlap = iou_bev(found, truth.boxes)
    ignored = overlap[:, ~counts].max(axis=1, initial=0.0)
    wanted = overlap[:, counts].max(axis=1, initial=0.0)
    kept = (ignored < IGNORED_IOU) | (wanted >= ignored)
    return found.take(kept), truth.boxes.take(counts)


def _in_range(boxes: Boxes, own_from_world: Matrix, reach_m: tuple[float, float]) -> Boxes:
    near = boxes.centers @ own_from_world[:3, :3].T + own_from_world[:3, 3]
    inside = np.flatnonzero((np.abs(near[:, :2]) <= reach_m).all(axis=1))
    return boxes.take(inside)


def disturbed(pose: Pose, robot: str, frame: int, sigma: float) -> Pose:
    """Where a robot believes that its sensor is: off by `sigma` metres and degrees (standard
    deviation), drawn from (robot, frame) alone."""
    if sigma == 0.0:
        return pose
    x, y, turn = np.random.default_rng([frame, *robot.encode()]).normal(0.0, sigma, 3).tolist()
    return Pose(
        pose.x + x, pose.y + y, pose.z, pose.roll, pose.pitch, pose.yaw + math.radians(turn)
    )
