"""Analyze: one unified scene from what all robots say they see.

Robots that may take part become candidates, all others are excluded with a reason. Objects that
several robots see are merged; what each robot sees is put on one grid around the ego.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ego_agent.grid import Grid
from ego_agent.knowledge import Knowledge
from ego_agent.merge import merge_nearby
from ego_agent.model import Candidate, RobotView, Snapshot, UnifiedScene
from ego_agent.objective import Objective
from swarm.arrays import unpack_finite
from swarm.errors import MessageError
from swarm.geometry import Pose
from swarm.messages import Algorithm, SceneDescription

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


def analyze(snapshot: Snapshot, knowledge: Knowledge) -> UnifiedScene:
    """The unified scene of a snapshot; never raises for what robots sent.

    Where the ego's own beacon cannot be used its id is in `excluded` too, there are no candidates,
    and its pose is the last known one, or the origin.
    """
    objective = knowledge.objective
    capacity = snapshot.capacity_bps
    capacity = capacity if math.isfinite(capacity) and capacity >= 1.0 else 1.0
    ego_view = snapshot.robots.get(snapshot.ego)
    ego_pose = ego_view.beacon.sensor_pose() if ego_view and ego_view.beacon else Pose(0, 0, 0)
    trouble = _why_not_ego(ego_view, objective)
    excluded = {snapshot.ego: trouble} if trouble else {}
    seen = {snapshot.ego: _seen_by_ego(ego_view, objective)}
    chosen: list[tuple[float, RobotView, dict[Algorithm, int]]] = []
    for robot, view in sorted(snapshot.robots.items()):
        if robot == snapshot.ego:
            continue
        sizes: dict[Algorithm, int] = {}
        if view.beacon is not None:
            sizes = knowledge.payload_sizes(robot, view.beacon.sizes, snapshot.now_ns)
        reason = _why_not(view, ego_pose, sizes, objective) if not trouble else _NO_EGO
        if reason is None:
            try:
                seen[robot] = _seen(view, objective)
            except MessageError as error:
                reason = f"its scene description is not valid: {error}"
        if reason is not None:
            excluded[robot] = reason
        elif view.beacon is not None:
            chosen.append((view.beacon.sensor_pose().distance_to(ego_pose), view, sizes))
    chosen.sort(key=lambda item: (item[0], item[1].robot))
    order = [snapshot.ego, *(view.robot for _, view, _ in chosen)]
    grid = Grid(ego_pose.x, ego_pose.y, objective.area_half_m)
    objects, evidence = _merge(grid, _positions(snapshot, objective), [seen[r] for r in order])
    poses = [ego_pose, *(v.beacon.sensor_pose() for _, v, _ in chosen if v.beacon is not None)]
    members = tuple(
        Candidate(
            robot=robot,
            pose=pose,
            distance_m=pose.distance_to(ego_pose),
            sizes=sizes,
            area=grid.visible(pose.x, pose.y, seen[robot].visible_m),
            evidence=row,
        )
        for robot, pose, sizes, row in zip(
            order, poses, [{}, *(sizes for _, _, sizes in chosen)], evidence, strict=True
        )
    )
    return UnifiedScene(
        ego=members[0],
        candidates=members[1:],
        excluded=excluded,
        objects=objects,
        cell_m=grid.cell_m,
        capacity_bps=capacity,
    )


_NO_EGO = "the ego's own position is not known"


def _why_not_ego(view: RobotView | None, objective: Objective) -> str | None:
    """Why the ego's own state cannot be confirmed, or None. Its token does not matter: it runs."""
    if view is None or view.beacon is None:
        return "no beacon of the ego has arrived"
    if view.duplicate:
        return "two processes use the ego's id"
    return _stale(view, objective)


def _why_not(
    view: RobotView, ego: Pose, sizes: dict[Algorithm, int], objective: Objective
) -> str | None:
    """Why a robot may not take part, as the rest of a sentence, or None if it may."""
    if not view.alive:
        return "it has left: no liveliness token"
    if view.duplicate:
        return "two processes use its id"
    if view.beacon is None:
        return "no beacon of it has arrived"
    if stale := _stale(view, objective):
        return stale
    distance = view.beacon.sensor_pose().distance_to(ego)
    if not distance <= objective.comm_range_m:
        return f"it is {distance:.1f} m away, the range is {objective.comm_range_m:.1f} m"
    if not sizes:
        return "the size of its observations is not known"
    return None


def _stale(view: RobotView, objective: Objective) -> str | None:
    if view.beacon_age_s <= objective.beacon_max_age_s:
        return None
    return (
        f"its beacon is {view.beacon_age_s:.1f} s old, "
        f"at most {objective.beacon_max_age_s:.1f} s is allowed"
    )


def _seen_by_ego(view: RobotView | None, objective: Objective) -> _Seen:
    """The ego sees nothing rather than failing when its own scene cannot be used."""
    if view is None:
        return _nothing()
    try:
        return _seen(view, objective)
    except MessageError:
        return _nothing()


def _seen(view: RobotView, objective: Objective) -> _Seen:
    """What a robot's newest description holds; nothing where there is none or it is too old.

    Raises MessageError when its arrays are not what they must be.
    """
    scene: SceneDescription | None = view.scene
    if scene is None or not view.scene_age_s <= objective.scene_max_age_s:
        return _nothing()
    objects = unpack_finite(scene.objects, "objects", 9)
    visible = unpack_finite(scene.visible_m, "visible_m", 1)[:, 0]
    if len(objects) > MAX_OBJECTS:
        objects = objects[np.argsort(-objects[:, _POINTS], kind="stable")[:MAX_OBJECTS]]
    decay = 0.5 ** (max(0.0, view.scene_age_s - FRESH_S) / HALF_LIFE_S)
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
    if len(robots) and len(objects):
        gaps = objects[:, None, :2] - robots[None]
        keep = (gaps**2).sum(axis=2).min(axis=1) > SELF_M**2
        objects, evidence, owner = objects[keep], evidence[keep], owner[keep]
    group = merge_nearby(objects[:, :2], evidence, MERGE_M)
    count = int(group.max()) + 1 if len(group) else 0
    weight = np.bincount(group, evidence, count)
    centroids = np.column_stack(
        [np.bincount(group, evidence * objects[:, axis], count) / weight for axis in range(3)]
    )
    table = np.zeros((len(seen), count), dtype=np.float32)
    np.maximum.at(table, (owner, group), evidence.astype(np.float32))
    return centroids.astype(np.float32), table
