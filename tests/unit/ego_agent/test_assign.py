"""Each participant at its own rate: what it adds against what it costs, steadily."""

from __future__ import annotations

import itertools
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.compute import Work
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.pace import RARER_HZ, due
from ego_agent.plan.assign import assigned
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.static import Static
from swarm.messages import Assignment, Decision
from tests.support.ego_scenes import NOW_NS, candidate, knowledge, scene, snapshot


def rarer(**objective: Any) -> Knowledge:
    known = knowledge(**objective)
    known.objective = msgspec.structs.replace(known.objective, rarer_hz=RARER_HZ)
    return known


def a_floor(capacity_bps: float = 20e6) -> UnifiedScene:
    """B shows much of its own, C very little."""
    return scene(
        candidate("E", range(20), [1.0]),
        candidate("B", range(20, 60), [0, 1.0], distance_m=5),
        candidate("C", range(59, 62), [1.0], distance_m=9),
        capacity_bps=capacity_bps,
    )


def decide(found: UnifiedScene, known: Knowledge, previous: Decision | None = None) -> Decision:
    """Everybody takes part, with points."""
    return plan(snapshot(), found, Static("early"), known, previous, 7, NOW_NS)


def rates(decision: Decision) -> dict[str, float]:
    return {one.robot: one.rate_hz for one in decision.assignments}


def test_without_rarer_rates_nothing_is_assigned() -> None:
    assert decide(a_floor(), knowledge()).assignments == ()


def test_who_adds_little_is_asked_less_often() -> None:
    known = rarer(lambda_link=0.02)
    usual = decide(a_floor(), knowledge(lambda_link=0.02))
    decision = decide(a_floor(), known)
    assert usual.participants == decision.participants == ("E", "B", "C")
    assert rates(decision)["B"] > rates(decision)["C"]
    assert decision.quality < usual.quality
    assert decision.cost_bytes < usual.cost_bytes
    assert "Memory carries on" in decision.reason


def test_where_bytes_cost_nothing_everybody_contributes_in_every_frame() -> None:
    assert decide(a_floor(), rarer(lambda_link=0.0, lambda_compute=0.0)).assignments == ()


def test_the_dearer_the_link_the_rarer() -> None:
    sums = [
        sum(rates(decide(a_floor(), rarer(lambda_link=weight, q_min=0.0))).values() or [20.0])
        for weight in (0.0, 0.01, 0.03)
    ]
    assert sums == sorted(sums, reverse=True)
    assert sums[0] > sums[-1]


def test_bytes_and_quality_are_those_of_the_rates() -> None:
    usual, decision = (decide(a_floor(), make(lambda_link=0.02)) for make in (knowledge, rarer))
    sizes = {c.robot: c.sizes[decision.algorithm] for c in a_floor().candidates}
    mean = sum(sizes[robot] * hz / decision.rate_hz for robot, hz in rates(decision).items())
    assert decision.cost_bytes == pytest.approx(mean, abs=1)
    assert 0.0 < decision.quality <= usual.quality


def test_a_rate_stays_while_another_is_hardly_better() -> None:
    known = rarer(lambda_link=0.02)
    first = decide(a_floor(), known)
    again = first
    for capacity_bps in (20.3e6, 19.7e6, 20.1e6, 19.9e6):
        again = decide(a_floor(capacity_bps), known, again)
        assert rates(again) == rates(first)


@given(
    st.lists(st.sampled_from((10.0, *RARER_HZ)), min_size=1, max_size=6),
    st.integers(0, 1000),
)
def test_each_contributes_as_often_as_assigned(given_hz: list[float], first: int) -> None:
    robots = [f"R{i}" for i in range(2, 2 + len(given_hz))]
    decision = msgspec.structs.replace(
        decide(a_floor(), knowledge()),
        participants=("R1", *robots),
        assignments=tuple(
            Assignment(robot=robot, algorithm="early", rate_hz=hz)
            for robot, hz in zip(robots, given_hz, strict=True)
        ),
    )
    for robot, hz in zip(robots, given_hz, strict=True):
        frames = [n for n in range(first, first + 20) if due(decision, robot, n)]
        assert len(frames) == 2 * hz
        assert len({b - a for a, b in itertools.pairwise(frames)}) <= 1


def test_robots_of_one_rate_take_turns() -> None:
    robots = [f"R{i}" for i in range(2, 7)]
    decision = msgspec.structs.replace(
        decide(a_floor(), knowledge()),
        participants=("R1", *robots),
        assignments=tuple(
            Assignment(robot=robot, algorithm="early", rate_hz=2.0) for robot in robots
        ),
    )
    for number in range(10):
        assert sum(due(decision, robot, number) for robot in robots) == 1


def test_who_is_not_assigned_is_due_in_every_frame() -> None:
    decision = decide(a_floor(), knowledge())
    assert all(due(decision, "B", number) for number in range(10))


def test_an_ego_alone_is_left_as_it_is() -> None:
    alone = scene(candidate("E", range(20), [1.0]))
    decision = decide(alone, knowledge())
    assert assigned(decision, alone, rarer(), None) is decision


def test_memory_takes_the_place_of_fewer_frames() -> None:
    dear: dict[str, Any] = {"lambda_compute": 0.0, "lambda_link": 0.2, "slower_hz": (5.0, 1.0)}
    usual = decide(a_floor(), knowledge(q_min=0.0, **dear))
    with_memory = decide(a_floor(), rarer(q_min=0.0, **dear))
    assert usual.rate_hz < with_memory.rate_hz == 10.0
    assert min(rates(with_memory).values()) < usual.rate_hz


@given(st.floats(2e5, 3e6))
def test_where_the_link_does_not_carry_all_in_every_frame_they_are_asked_less_often(
    capacity_bps: float,
) -> None:
    found = a_floor(capacity_bps)
    free: dict[str, Any] = {"lambda_link": 0.0, "lambda_compute": 0.0}
    usual, decision = (decide(found, make(q_min=0.0, **free)) for make in (knowledge, rarer))
    sizes = {c.robot: c.sizes["early"] for c in found.candidates}
    hz = rates(decision) or dict.fromkeys(decision.participants[1:], decision.rate_hz)
    assert set(decision.participants) >= set(usual.participants)
    if decision.algorithm == usual.algorithm:
        assert decision.quality >= usual.quality - 1e-9
    if decision.algorithm == "early":
        assert sum(8.0 * sizes[robot] * often for robot, often in hz.items()) <= 0.8 * capacity_bps


def test_points_of_all_come_less_often_rather_than_boxes_in_every_frame() -> None:
    usual, decision = (decide(a_floor(1.5e6), make(q_min=0.0)) for make in (knowledge, rarer))
    assert (usual.algorithm, decision.algorithm) == ("late", "early")
    assert decision.participants == ("E", "B", "C")
    assert usual.repairs
    assert not decision.repairs


def test_rates_that_a_link_dictates_stay_while_it_wavers() -> None:
    known = rarer(q_min=0.0)
    first = decide(a_floor(1.5e6), known)
    again = first
    for capacity_bps in (1.52e6, 1.49e6, 1.51e6, 1.5e6):
        again = decide(a_floor(capacity_bps), known, again)
        assert rates(again) == rates(first)


@pytest.mark.parametrize("capacity_bps", [3e5, 1.5e6, 20e6])
def test_an_ego_without_time_to_spare_leaves_nobody_out_for_it(capacity_bps: float) -> None:
    known, found = rarer(q_min=0.0), a_floor(capacity_bps)
    usual = decide(found, known)
    known._works = {
        name: Work(encode_ms=1.0, fixed_ms=150.0, add_ms=5.0)
        for name in ("early", "late", "single")
    }
    assert known.fixed_s() * 10.0 > 1.0
    busy = decide(found, known)
    assert (busy.participants, busy.source) == (usual.participants, "policy")
    rated = Mixes(Scorer(found, known)).rated(("B", "C"), "early")
    assert rated.participants == ("B", "C")
