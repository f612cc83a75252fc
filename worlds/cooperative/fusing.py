"""Fuses single frames of a world as a swarm would, without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from perception.fusion.aligner import Remembering
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.compensation import MotionCompensation, OwnScan
from perception.fusion.detectors import shared_finder
from perception.fusion.known import KnownRobot, seen_at
from perception.fusion.mixed import Mixed, scored_by
from perception.fusion.publishing import publish
from perception.fusion.registry import make_fusion
from perception.types import Boxes
from swarm.errors import PerceptionError, WorldError
from swarm.geometry import Matrix, Points
from worlds.base import World, body_of
from worlds.cooperative.pose_errors import PoseErrors, disturbed

SINGLE = "single"
"""Not a fusion: the ego's own scan alone."""
HISTORY_FRAMES = 3
"""Where contributions come late, the ego has fused the frame this long before, too."""


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
    """One fused frame in the world frame."""

    boxes: Boxes
    """Detections: what the ego would publish, known robots apart."""
    bytes: dict[str, int]
    """Payload of each contribution."""
    rejected: dict[str, str]
    found: Boxes
    """All that the detector found, with its own scores."""
    known: tuple[KnownRobot, ...]
    """All robots but the ego, where their beacons say that they are, or what they sent shows."""
    sent_points: Mapping[str, tuple[Points, Matrix]] = field(default_factory=dict)
    """By robot: its decoded points in its sensor's frame, and the sensor in the world frame."""


def fuse_frame(
    world: World,
    frame: int,
    ego: str,
    participants: Sequence[str],
    algorithm: str | Fusion,
    disturbance: Disturbance | None = None,
    *,
    forms: Mapping[str, str] | None = None,
    poses: Remembering | None = None,
) -> Fused:
    """Encodes the participants' scans, decodes and fuses them at the ego.

    `participants` may or may not hold the ego, which always takes part. `forms`: the algorithm of
    each participant, in place of `algorithm`, where they differ. `poses`: what is known of
    senders' poses; without, the frame speaks for itself. Noise is drawn from (robot, frame)
    alone, so a run repeats exactly.

    >>> from worlds.registry import open_world
    >>> world = open_world("factory", robots=3, rings=16)
    >>> fused = fuse_frame(world, 0, "R1", ["R2", "R3"], "late")
    >>> sorted(fused.bytes), max(fused.bytes.values()) < 2000
    (['R2', 'R3'], True)

    Raises WorldError for an unknown robot and PerceptionError for an unknown algorithm.
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
        found = boxes.transformed(scan.pose.matrix())
        return _published(world, frame, ego, SINGLE, found, {}, {}, disturbance)
    if forms:
        made = {name: make_fusion(name, world.detector) for name in sorted({*forms.values()})}
        fusion: Fusion = Mixed(made, {robot: forms[robot] for robot in senders if robot in forms})
        senders = [robot for robot in senders if robot in forms]
    elif isinstance(algorithm, str):
        fusion = make_fusion(algorithm, world.detector)
    else:
        fusion = algorithm
    late = round(disturbance.delay_s * world.rate_hz)
    if not late:
        own = _own_scan(world, ego, frame)
        gathering = fusion.begin(own.points, own.world_from_own)
        if poses is not None:
            gathering.remembered = poses.at(own.time_s, own.time_s, own.world_from_own)
        return _gathered(gathering, fusion, world, senders, frame, frame, disturbance, ego)
    # The ego knows how things move from its frames before.
    motion = MotionCompensation(world.detector, poses=poses)
    times = [max(0, frame - HISTORY_FRAMES), frame]
    sent = [max(0, now - late) for now in times]
    for at in sorted({*times, *sent}):
        own = _own_scan(world, ego, at)
        if at not in times:
            motion.remember(own)
            continue
        gathering = motion.begin(fusion, own)
        captured = max(0, at - late)
        fused = _gathered(gathering, fusion, world, senders, at, captured, disturbance, ego)
    return fused


def _gathered(
    gathering: Gathering,
    fusion: Fusion,
    world: World,
    senders: Sequence[str],
    frame: int,
    captured: int,
    disturbance: Disturbance,
    ego: str,
) -> Fused:
    """The senders' contributions of the frame `captured`, fused by the ego in `frame`."""
    age_s = (frame - captured) / world.rate_hz
    sizes, rejected = {}, {}
    for robot in senders:
        scan = world.scan(robot, captured)
        pose = disturbed(scan.pose, robot, frame, disturbance.pose_noise_m)
        form, encoder = "", fusion
        if isinstance(fusion, Mixed):
            form = fusion.sends[robot]
            encoder = fusion.forms[form]
        ask = gathering.ask_for(form) if form else gathering.ask()
        options = EncodeOptions(pose=pose, reference=ask.reference, demand=ask.demand)
        payload = encoder.encode(scan.points, options)
        sizes[robot] = len(payload) + ask.size()
        try:
            gathering.add(Contribution(robot, payload, pose.matrix(), age_s, form))
        except PerceptionError as error:
            rejected[robot] = str(error)
    found, corrections = gathering.finish(), gathering.corrections()
    rejected |= gathering.left_out()
    fused = _published(world, frame, ego, fusion, found, sizes, rejected, disturbance, corrections)
    return replace(fused, sent_points=gathering.sent_points())


def _published(
    world: World,
    frame: int,
    ego: str,
    algorithm: str | Fusion,
    found: Boxes,
    sizes: dict[str, int],
    rejected: dict[str, str],
    disturbance: Disturbance,
    corrections: Mapping[str, Matrix] | None = None,
) -> Fused:
    known = known_robots(world, frame, ego, disturbance.pose_noise_m)
    known = seen_at(known, corrections or {})
    helpers = len(sizes) - len(rejected)
    if isinstance(algorithm, Mixed):
        used = [form for robot, form in algorithm.sends.items() if robot not in rejected]
        algorithm = algorithm.forms[scored_by(used)] if used else SINGLE
    boxes = publish(found, world.detector, algorithm, helpers, known)
    return Fused(boxes, sizes, rejected, found, known)


def known_robots(
    world: World,
    frame: int,
    ego: str,
    pose_noise_m: float = 0.0,
    errors: PoseErrors = "anew",
    run: int = 0,
) -> tuple[KnownRobot, ...]:
    """All robots but the ego, where they believe to be in a frame: what fresh beacons tell. The
    noise is that of `disturbed`."""
    return tuple(
        KnownRobot(
            robot,
            body_of(world, robot),
            disturbed(world.pose(robot, frame), robot, frame, pose_noise_m, errors, run).matrix(),
        )
        for robot in world.robots
        if robot != ego
    )


def _own_scan(world: World, ego: str, frame: int) -> OwnScan:
    scan = world.scan(ego, frame)
    return OwnScan(frame / world.rate_hz, scan.points, scan.pose.matrix())
