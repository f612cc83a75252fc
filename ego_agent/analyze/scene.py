"""Analyze: one unified scene from what all robots say they see.

Robots that may take part become candidates, all others are excluded with a reason. Objects that
several robots see are merged; what each robot sees is put on one grid around the ego. Of living
robots in range that are excluded, or whose scene is old, what they showed last counts in what all
could show: blind is not perfect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ego_agent.analyze.grid import Grid
from ego_agent.analyze.merge import are_near, merge_nearby
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Candidate, RobotView, Snapshot, UnifiedScene
from ego_agent.knowledge.objective import Objective
from swarm.arrays import unpack_finite
from swarm.errors import MessageError
from swarm.geometry import Pose
from swarm.messages import Algorithm, SceneDescription

DUPLICATE = "two processes use its id"
MERGE_M = 1.5
"""Objects whose centroids are this close in the ground plane are one."""
SELF_M = 1.0
"""An object this close to a robot's own position is that robot."""
FULL_EVIDENCE_POINTS = 30.0
"""Points that make a robot's evidence of an object complete: above 30 points the scene
description found every vehicle of the real frames, between 10 and 29 hardly any."""
FRESH_S = 1.0
"""Evidence does not decay before this age: two scene periods."""
HALF_LIFE_S = 2.0
"""After that it halves in this time."""
MAX_OBJECTS = 256
"""Objects taken from one robot, those with the most points first."""

_X, _Y, _POINTS = 0, 1, 7  # columns of SceneDescription.objects


@dataclass(frozen=True, slots=True)
class _Seen:
    """What one robot says it sees: objects (N, 9) float32, evidence (N,), visible (S,)."""

    objects: NDArray[np.float32]
    evidence: NDArray[np.float64]
    visible_m: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class _Member:
    """A robot that is part of the unified scene: the ego, or a candidate in the making."""

    robot: str
    pose: Pose
    distance_m: float
    sizes: dict[Algorithm, int]
    seen: _Seen
    capacity_bps: float = math.inf
    shared: frozenset[Algorithm] = frozenset()


def analyze(snapshot: Snapshot, knowledge: Knowledge) -> UnifiedScene:
    """The unified scene of a snapshot; never raises for what robots sent.

    Where the ego's own beacon cannot be used its id is in `excluded` too, there are no candidates,
    and its pose is the last known one, or the origin.
    """
    objective = knowledge.objective
    ego = _ego(snapshot, objective)
    trouble = _why_not_ego(snapshot.robots.get(snapshot.ego), objective)
    excluded = {snapshot.ego: trouble} if trouble else {}
    members: list[_Member] = []
    unheard: list[_Member] = []
    unknown = 0
    for robot, view in snapshot.robots.items():
        if robot == snapshot.ego:
            continue
        member = _NO_EGO if trouble else _member(robot, view, ego.pose, snapshot, knowledge)
        if isinstance(member, str):
            excluded[robot] = member
        else:
            members.append(member)
            if _scene_in_time(view, objective):
                continue
        if not view.alive or _out_of_range(view, ego.pose, objective):
            continue
        last = _last_seen(robot, view, ego.pose)
        if last is None:
            unknown += 1
        else:
            unheard.append(last)
    members.sort(key=lambda member: (member.distance_m, member.robot))
    members.insert(0, ego)
    grid = Grid(ego.pose.x, ego.pose.y, objective.area_half_m)
    robots = _positions(snapshot, objective)
    everyone = [*members, *unheard]
    objects, evidence = _merge(grid, robots, [member.seen for member in everyone])
    capacity = snapshot.capacity_bps
    capacity_bps = capacity if math.isfinite(capacity) and capacity >= 1.0 else 1.0
    learnt = knowledge.experience.learnt(capacity_bps, configured=snapshot.capacity_is_configured)
    found = tuple(
        Candidate(
            robot=member.robot,
            pose=member.pose,
            distance_m=member.distance_m,
            sizes=member.sizes,
            area=grid.visible(member.pose.x, member.pose.y, member.seen.visible_m),
            evidence=row,
            capacity_bps=member.capacity_bps,
            answers=learnt.of(member.robot, member.sizes) if knowledge.learns else {},
            placed=knowledge.placing.share(member.robot) if knowledge.learns else 1.0,
            shared=member.shared,
            focused=knowledge.focused_sizes(member.robot, snapshot.now_ns),
            objects=knowledge.object_sizes(member.robot, snapshot.now_ns),
        )
        for member, row in zip(everyone, evidence, strict=True)
    )
    return UnifiedScene(
        ego=found[0],
        candidates=found[1 : len(members)],
        excluded=excluded,
        objects=objects,
        cell_m=grid.cell_m,
        capacity_bps=capacity_bps,
        unheard=found[len(members) :],
        unknown=unknown,
    )


_NO_EGO = "the ego's own position is not known"


def _ego(snapshot: Snapshot, objective: Objective) -> _Member:
    """The ego; it sees nothing rather than failing when its own scene cannot be used."""
    view = snapshot.robots.get(snapshot.ego)
    pose = view.beacon.sensor_pose() if view is not None and view.beacon else Pose(0.0, 0.0, 0.0)
    try:
        seen = _seen(view, objective) if view is not None else _nothing()
    except MessageError:
        seen = _nothing()
    return _Member(snapshot.ego, pose, 0.0, {}, seen)


def _member(
    robot: str, view: RobotView, ego: Pose, snapshot: Snapshot, knowledge: Knowledge
) -> _Member | str:
    """A robot that may take part, or why it may not, as the rest of a sentence."""
    objective = knowledge.objective
    if not view.alive:
        return "it has left: no liveliness token"
    if view.duplicate:
        return DUPLICATE
    if view.misfit:
        return view.misfit
    if view.beacon is None:
        return "no beacon of it has arrived"
    if stale := _stale(view, objective):
        return stale
    pose = view.beacon.sensor_pose()
    distance = pose.distance_to(ego)
    if not distance <= objective.comm_range_m:
        return f"it is {distance:.1f} m away, the range is {objective.comm_range_m:.1f} m"
    sizes = knowledge.payload_sizes(robot, view.beacon.sizes, snapshot.now_ns)
    if not sizes:
        return "the size of its observations is not known"
    try:
        seen = _seen(view, objective)
    except MessageError as error:
        return f"its scene description is not valid: {error}"
    shared = frozenset(view.beacon.shared) if knowledge.shares else frozenset()
    return _Member(robot, pose, distance, sizes, seen, view.capacity_bps, shared)


def _scene_in_time(view: RobotView, objective: Objective) -> bool:
    return view.scene is not None and view.scene_age_s <= objective.scene_max_age_s


def _out_of_range(view: RobotView, ego: Pose, objective: Objective) -> bool:
    """Whether a robot was out of range when it was heard last."""
    told = view.beacon or view.scene
    return told is not None and not (told.sensor_pose().distance_to(ego) <= objective.comm_range_m)


def _last_seen(robot: str, view: RobotView, ego: Pose) -> _Member | None:
    """A robot as it was seen last, however long ago; None where nothing usable came of it."""
    if view.scene is None:
        return None
    try:
        seen = _shown(view.scene, decay=1.0)
    except MessageError:
        return None
    pose = view.scene.sensor_pose()
    return _Member(robot, pose, pose.distance_to(ego), {}, seen, view.capacity_bps)


def _why_not_ego(view: RobotView | None, objective: Objective) -> str | None:
    """Why the ego's own state cannot be confirmed, or None. Its token does not matter: it runs."""
    if view is None or view.beacon is None:
        return "no beacon of the ego has arrived"
    if view.duplicate:
        return "two processes use the ego's id"
    if view.off_duty:
        return f"its own robot was taken off duty by {view.off_duty}"
    return _stale(view, objective)


def _stale(view: RobotView, objective: Objective) -> str | None:
    """Why what a robot said is too old, or None; its beacon's times are both its own clock's."""
    beacon, limit_s = view.beacon, objective.beacon_max_age_s
    if beacon is None:
        return None
    stood_s = (beacon.sent_ns - beacon.capture_ns) * 1e-9
    if view.beacon_age_s <= limit_s and stood_s <= limit_s:
        return None
    allowed = f"at most {limit_s:.1f} s is allowed"
    if stood_s > limit_s:
        return f"its newest frame was {stood_s:.1f} s old when its beacon left, {allowed}"
    if view.delay_s > limit_s / 2.0:
        return (
            f"its beacon shows it as it was {view.beacon_age_s:.1f} s ago, {allowed}: "
            f"it was {view.delay_s:.1f} s on its way"
        )
    return f"its beacon is {view.beacon_age_s:.1f} s old, {allowed}"


def _seen(view: RobotView, objective: Objective) -> _Seen:
    """What a robot's newest description holds; nothing where there is none or it is too old.

    Raises MessageError when its arrays are not what they must be.
    """
    scene: SceneDescription | None = view.scene
    if scene is None or not _scene_in_time(view, objective):
        return _nothing()
    return _shown(scene, decay=0.5 ** (max(0.0, view.scene_age_s - FRESH_S) / HALF_LIFE_S))


def _shown(scene: SceneDescription, *, decay: float) -> _Seen:
    objects = unpack_finite(scene.objects, "objects", 9)
    visible = unpack_finite(scene.visible_m, "visible_m", 1)[:, 0]
    if len(objects) > MAX_OBJECTS:
        objects = objects[np.argsort(-objects[:, _POINTS], kind="stable")[:MAX_OBJECTS]]
    points = np.clip(objects[:, _POINTS].astype(np.float64), 0.0, FULL_EVIDENCE_POINTS)
    return _Seen(objects, decay * points / FULL_EVIDENCE_POINTS, visible)


def _nothing() -> _Seen:
    return _Seen(np.zeros((0, 9), np.float32), np.zeros(0), np.zeros(0, np.float32))


def _positions(snapshot: Snapshot, objective: Objective) -> NDArray[np.float64]:
    """World x, y of every robot with a fresh beacon, also of those that may not take part."""
    places = [
        view.beacon.pose[:2]
        for view in snapshot.robots.values()
        if view.beacon is not None and view.beacon_age_s <= objective.beacon_max_age_s
    ]
    return np.array(places, dtype=np.float64).reshape(-1, 2)


def _merge(
    grid: Grid, robots: NDArray[np.float64], seen: list[_Seen]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Merged centroids (K, 3) and evidence (len(seen), K).

    Left out: objects off the grid, without points, and those that are a robot: beacons tell where
    robots are, so seeing them adds nothing to a decision.
    """
    objects = np.concatenate([s.objects[:, :3] for s in seen]).astype(np.float64)
    evidence = np.concatenate([s.evidence for s in seen])
    owner = np.repeat(np.arange(len(seen)), [len(s.objects) for s in seen])
    keep = grid.contains(objects[:, _X], objects[:, _Y]) & (evidence > 0.0)
    objects, evidence, owner = objects[keep], evidence[keep], owner[keep]
    apart = ~are_near(objects[:, :2], robots, SELF_M)
    objects, evidence, owner = objects[apart], evidence[apart], owner[apart]
    group = merge_nearby(objects[:, :2], evidence, MERGE_M)
    count = int(group.max()) + 1 if len(group) else 0
    weight = np.bincount(group, evidence, count)
    centroids = np.column_stack(
        [np.bincount(group, evidence * objects[:, axis], count) / weight for axis in range(3)]
    )
    table = np.zeros((len(seen), count), dtype=np.float32)
    np.maximum.at(table, (owner, group), evidence.astype(np.float32))
    return centroids.astype(np.float32), table
