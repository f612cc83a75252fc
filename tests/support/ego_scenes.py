"""Snapshots and scenes for the tests of the control cycle's pure middle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Candidate, Proposal, RobotView, Snapshot, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import algorithm_of, rate_of
from swarm.arrays import Array, pack
from swarm.geometry import Pose
from swarm.messages import ALGORITHMS, MIXED, Algorithm, Beacon, Decision, SceneDescription

NOW_NS = 1_700_000_000_000_000_000
BOTH: tuple[Algorithm, ...] = ("early", "late")


def knowledge(algorithms: Sequence[str] = BOTH, **objective: Any) -> Knowledge:
    return Knowledge(Objective(**{"q_min": 0.7, **objective}), algorithms)


def objects(*rows: tuple[float, float, float]) -> Array:
    """Objects at (x, y) with a number of points, as in a scene description."""
    table = np.ones((len(rows), 9), dtype=np.float32)
    if rows:
        table[:, [0, 1, 7]] = rows
    return pack(table)


def view(
    robot: str,
    x: float = 0.0,
    y: float = 0.0,
    *,
    sees: Array | None = None,
    visible: Sequence[float] = (10.0,) * 8,
    visible_m: Array | None = None,
    sizes: Mapping[str, int] | None = None,
    alive: bool = True,
    duplicate: bool = False,
    beacon: bool = True,
    beacon_age_s: float = 0.1,
    scene: bool = True,
    scene_age_s: float = 0.3,
    capacity_bps: float = math.inf,
) -> RobotView:
    pose = (x, y, 1.5, 0.0, 0.0, 0.0)
    if visible_m is None:
        visible_m = pack(np.array(visible, dtype=np.float32).reshape(-1, 1))
    head: dict[str, Any] = {
        "robot": robot,
        "instance": 1,
        "seq": 1,
        "sent_ns": 0,
        "capture_ns": 0,
        "frame": 1,
    }
    announced = dict({"early": 12_000, "late": 600} if sizes is None else sizes)
    return RobotView(
        robot=robot,
        alive=alive,
        beacon=Beacon(**head, pose=pose, velocity=(0.0, 0.0, 0.0), range_m=50.0, sizes=announced)
        if beacon
        else None,
        beacon_age_s=beacon_age_s,
        scene=SceneDescription(
            **head,
            pose=pose,
            objects=objects() if sees is None else sees,
            visible_m=visible_m,
            ground_points=0,
            elapsed_ms=1.0,
        )
        if scene
        else None,
        scene_age_s=scene_age_s,
        round_trip_s=None,
        clock_offset_s=0.0,
        duplicate=duplicate,
        capacity_bps=capacity_bps,
    )


def snapshot(*views: RobotView, ego: str = "E", capacity_bps: float = 20e6) -> Snapshot:
    return Snapshot(
        ego=ego,
        cycle=7,
        now_ns=NOW_NS,
        robots={v.robot: v for v in views},
        capacity_bps=capacity_bps,
        capacity_source="prior",
    )


def candidate(
    robot: str,
    cells: Sequence[int] = (),
    evidence: Sequence[float] = (),
    *,
    of: tuple[int, int] = (8, 4),
    sizes: Mapping[Algorithm, int] | None = None,
    distance_m: float = 10.0,
    capacity_bps: float = math.inf,
    shared: Sequence[Algorithm] = (),
) -> Candidate:
    """A candidate that sees some numbered cells of a grid of `of[0]` x `of[0]` cells, and the
    first objects of `of[1]` with the given evidence."""
    area = np.zeros(of[0] ** 2, dtype=bool)
    area[list(cells)] = True
    table = np.zeros(of[1], dtype=np.float32)
    table[: len(evidence)] = evidence
    return Candidate(
        robot=robot,
        pose=Pose(distance_m, 0.0, 0.0),
        distance_m=distance_m,
        sizes={"early": 12_000, "late": 600} if sizes is None else sizes,
        area=area.reshape(of[0], of[0]),
        evidence=table,
        capacity_bps=capacity_bps,
        shared=frozenset(shared),
    )


def scene(
    ego: Candidate,
    *candidates: Candidate,
    capacity_bps: float = 20e6,
    excluded: Mapping[str, str] | None = None,
) -> UnifiedScene:
    return UnifiedScene(
        ego=ego,
        candidates=candidates,
        excluded=excluded or {},
        objects=np.zeros((len(ego.evidence), 3), dtype=np.float32),
        cell_m=1.0,
        capacity_bps=capacity_bps,
    )


def proposal(*participants: str, algorithm: str = "early", made_ns: int | None = None) -> Proposal:
    return Proposal(participants, algorithm, "because", "policy", made_ns)


def assert_valid(decision: Decision, scene: UnifiedScene, knowledge: Knowledge) -> None:
    """What must hold for every decision, whoever proposed it."""
    ego, *others = decision.participants
    by_id = {c.robot: c for c in scene.candidates}
    assert ego == decision.ego == scene.ego.robot
    assert len(set(decision.participants)) == len(decision.participants)
    assert set(others) <= set(by_id)
    sends = {robot: (algorithm_of(decision, robot), rate_of(decision, robot)) for robot in others}
    kinds = {algorithm for algorithm, _ in sends.values()} or {decision.algorithm}
    assert kinds <= {*knowledge.algorithms} & {*ALGORITHMS}
    assert decision.algorithm == (kinds.pop() if len(kinds) == 1 else MIXED)
    bytes_s = sum(by_id[robot].sizes[name] * hz for robot, (name, hz) in sends.items())
    assert decision.cost_bytes == math.ceil(bytes_s / decision.rate_hz - 1e-6)
    allowed_bps = scene.capacity_bps * knowledge.objective.headroom
    assert not others or bytes_s * 8 <= allowed_bps * (1 + 1e-12)
    for robot, (name, hz) in sends.items():
        size_bps = by_id[robot].sizes[name] * 8 * hz
        own_bps = by_id[robot].capacity_bps * knowledge.objective.headroom
        sent_anyway = name in by_id[robot].shared
        assert sent_anyway or size_bps <= own_bps * (1 + 1e-12)
    assert 0.0 <= decision.quality <= 1.0
    assert decision.capacity_bps == scene.capacity_bps
    assert decision.valid == (scene.ego.robot not in scene.excluded)
