"""The journal's line of one control cycle, put together from what the stages leave behind."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ego_agent.knowledge.base import CycleResult
from ego_agent.knowledge.journal import (
    CycleRecord,
    Decided,
    Demand,
    Frames,
    Inputs,
    Latency,
    RobotInput,
)
from ego_agent.knowledge.model import Snapshot, UnifiedScene
from ego_agent.knowledge.tally import Tally
from ego_agent.knowledge.weighed import Weighed
from swarm.messages import Decision, NetDemand


def cycle_record(
    snapshot: Snapshot,
    scene: UnifiedScene | None,
    decision: Decision,
    tally: Tally,
    *,
    published: bool,
    cycle_ms: float,
    demand: NetDemand | None = None,
    weighed: Weighed | None = None,
) -> CycleRecord:
    """The line of a cycle from what it saw, decided and received."""
    known = {c.robot: c.answers for c in scene.candidates} if scene else {}
    deadline_s = decision.deadline_s or 0.0
    distances = {c.robot: c.distance_m for c in scene.candidates} if scene else {}
    own = snapshot.robots[snapshot.ego].beacon
    robots = {}
    for robot, view in snapshot.robots.items():
        distance = distances.get(robot)
        if distance is None and view.beacon is not None and own is not None:
            distance = view.beacon.sensor_pose().distance_to(own.sensor_pose())
        robots[robot] = RobotInput(
            alive=view.alive,
            distance_m=_rounded(distance, 2),
            beacon_age_s=_rounded(view.beacon_age_s, 3) if view.beacon else None,
            scene_age_s=_rounded(view.scene_age_s, 3) if view.scene else None,
            round_trip_s=_rounded(view.round_trip_s, 4),
            clock_offset_s=round(view.clock_offset_s, 4),
            sizes=view.beacon.sizes if view.beacon else {},
            capacity_bps=round(view.capacity_bps) if math.isfinite(view.capacity_bps) else None,
            in_time={
                name: round(answers.in_time(deadline_s), 3)
                for name, answers in known.get(robot, {}).items()
            },
            answer_ms={
                name: round(answers.answer_s * 1e3, 1)
                for name, answers in known.get(robot, {}).items()
                if answers.answer_s is not None
            },
        )
    return CycleRecord(
        ego=snapshot.ego,
        cycle=decision.cycle,
        started_ns=snapshot.now_ns,
        inputs=Inputs(
            robots=robots,
            excluded=dict(scene.excluded) if scene else {},
            capacity_bps=round(snapshot.capacity_bps),
            capacity_source=snapshot.capacity_source,
            capacity_error=_rounded(snapshot.capacity_error, 3),
        ),
        decision=Decided(
            participants=decision.participants,
            algorithm=decision.algorithm,
            reason=decision.reason,
            source=decision.source,
            policy=decision.policy,
            valid=decision.valid,
            repairs=decision.repairs,
            quality=decision.quality,
            cost_bytes=decision.cost_bytes,
            model=decision.model,
            rate_hz=decision.rate_hz,
            deadline_s=decision.deadline_s,
            arrival=decision.arrival,
            probe=decision.probe,
            held_s=_rounded(decision.held_s, 3),
            blind=decision.blind,
            silent=decision.silent,
            stands_in_for=decision.stands_in_for,
            assignments=decision.assignments,
        ),
        published=published,
        bytes=_nested(tally.received),
        frames=Frames(
            fused=tally.fused,
            skipped=tally.skipped,
            failed=tally.failed,
            late_answers=tally.late_answers,
            caught_up=tally.caught_up,
            boxes=tally.boxes,
        ),
        missing=_nested(tally.missing),
        latency=Latency(
            cycle_ms=round(cycle_ms, 3),
            frame_p50_ms=_rounded(tally.frame_p50_ms(), 3),
            frame_max_ms=_rounded(tally.frame_max_ms(), 3),
        ),
        outcome=_outcome(decision, tally),
        demand=None
        if demand is None
        else Demand(
            needed_bytes_s=demand.needed_bytes_s,
            possible=demand.possible,
            reachable=demand.reachable,
            unreachable_s=round(demand.unreachable_s, 3),
            mean_bytes_s=demand.mean_bytes_s,
            burst_bytes=demand.burst_bytes,
        ),
        advice=decision.advice,
        intents=decision.intents,
        weighed=weighed,
    )


def _outcome(decision: Decision, tally: Tally) -> str:
    if not tally.fused:
        return "no frames"
    if tally.missing:
        return "partial"
    return "alone" if len(decision.participants) == 1 else "complete"


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _nested(counts: Mapping[tuple[str, str], int]) -> dict[str, dict[str, int]]:
    """{(robot, name): n} as {robot: {name: n}}, sorted, for the journal."""
    nested: dict[str, dict[str, int]] = {}
    for (robot, name), count in sorted(counts.items()):
        nested.setdefault(robot, {})[name] = count
    return nested


def cycle_result(decision: Decision, tally: Tally) -> CycleResult:
    """What knowledge keeps of a cycle."""
    return CycleResult(
        cycle=decision.cycle,
        algorithm=decision.algorithm,
        participants=decision.participants,
        source=decision.source,
        quality=decision.quality,
        predicted_bytes=decision.cost_bytes,
        received_bytes=tally.received.total(),
        frames=tally.fused,
        latency_ms=tally.frame_p50_ms() or 0.0,
    )
