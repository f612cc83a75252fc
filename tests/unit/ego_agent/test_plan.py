from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, RobotView, UnifiedScene
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.policies.registry import make_policy
from swarm.messages import Decision, decode, encode
from tests.support.ego_scenes import (
    NOW_NS,
    assert_valid,
    candidate,
    knowledge,
    objects,
    proposal,
    scene,
    snapshot,
    view,
)

FLOOR = scene(candidate("E", range(20)), candidate("A", range(20, 40)), excluded={"D": "gone"})


class Saying:
    """A policy that proposes what it was told to, or fails."""

    name = "saying"

    def __init__(self, say: Callable[[], Any]) -> None:
        self._say = say

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        found: Proposal = self._say()
        return found


def decide(policy: Any, found: UnifiedScene = FLOOR, known: Knowledge | None = None) -> Decision:
    known = known or knowledge()
    decision = plan(snapshot(), found, policy, known, None, 9, NOW_NS)
    assert_valid(decision, found, known)
    assert decode(encode(decision), Decision) == decision
    assert decision.cycle == 9
    return decision


def test_a_usable_proposal_is_the_decision() -> None:
    decision = decide(Saying(lambda: proposal("E", "A", algorithm="late")))
    assert (decision.source, decision.policy) == ("policy", "saying")
    assert (decision.participants, decision.algorithm) == (("E", "A"), "late")


def test_coverage_decides_when_a_proposal_cannot_be_used() -> None:
    decision = decide(Saying(lambda: proposal("D", "ghost")))
    expected = decide(Coverage())
    assert (decision.source, decision.policy) == ("fallback", "saying")
    assert (decision.participants, decision.algorithm) == (
        expected.participants,
        expected.algorithm,
    )
    assert decision.repairs == (
        "dropped 'D': gone",
        "dropped 'ghost': no such robot is known",
        "added the ego, which always takes part",
        "refused: nobody of those it names can take part",
    )


def test_coverage_decides_when_a_policy_fails() -> None:
    def fail() -> Proposal:
        raise ValueError("out of ideas \udfff")

    decision = decide(Saying(fail))
    assert decision.source == "fallback"
    assert decision.participants == ("E", "A")
    assert decision.repairs == ("refused: saying failed with ValueError: out of ideas ?",)


def test_the_ego_goes_on_alone_when_the_fallback_fails_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object) -> Proposal:
        raise RuntimeError("no")

    monkeypatch.setattr(Coverage, "propose", fail)
    decision = decide(Saying(lambda: None))
    assert (decision.source, decision.participants) == ("fallback", ("E",))
    assert decision.repairs == (
        "refused: a proposal of type NoneType",
        "refused: coverage failed with RuntimeError: no",
    )


def test_without_a_confirmed_ego_every_policy_leaves_it_alone_and_says_so() -> None:
    found = analyze(snapshot(view("A", 5), view("B", 9)), knowledge())
    for name in ("coverage", "rules", "static-early", "static-late"):
        decision = decide(make_policy(name, ("early", "late")), found)
        assert decision.participants == ("E",)
        assert not decision.valid


texts = st.text(st.characters(), max_size=50)
names = st.sampled_from(["E", "A", "B", "C", "D", "F", "ghost"]) | texts | st.integers() | st.none()
participants = (
    st.lists(names, max_size=12).map(tuple) | st.lists(names, max_size=4) | texts | st.none()
)
proposals = (
    st.builds(
        Proposal,
        participants,
        st.sampled_from(["early", "late", "intermediate"]) | texts | st.none(),
        texts | st.none(),
        st.sampled_from(["policy", "llm", "cache", "fallback", "hold", "?"]) | st.none(),
        st.none() | st.integers(0, 2 * NOW_NS),
    )
    | st.none()
    | st.text()
)


def _seen(rows: list[tuple[float, float, float]]) -> Any:
    return objects(*rows)


near = st.floats(-50, 50)
robots = st.builds(
    view,
    st.sampled_from(["A", "B", "C", "D", "F"]),
    near,
    near,
    sees=st.lists(st.tuples(near, near, st.floats(0, 60)), max_size=6).map(_seen),
    visible=st.lists(st.floats(0, 30), max_size=8),
    sizes=st.dictionaries(st.sampled_from(["early", "late"]), st.integers(0, 50_000)),
    alive=st.integers(0, 9).map(bool),
    duplicate=st.integers(0, 9).map(lambda n: not n),
    beacon_age_s=st.sampled_from([0.1, 0.1, 0.1, 3.0]),
    scene_age_s=st.floats(0, 7),
    capacity_bps=st.just(math.inf) | st.floats(5e4, 5e6),
)
algorithms = st.sampled_from([("early",), ("late",), ("early", "late"), ("early", "intermediate")])


@settings(max_examples=300, deadline=None)
@given(
    st.lists(robots, max_size=6, unique_by=lambda v: v.robot),
    st.sampled_from([view("E"), view("E", visible=[20] * 8), view("E", beacon=False)]),
    st.floats(1, 1e8),
    proposals,
    algorithms,
    st.sampled_from([0.0, 0.7, 1.0]),
)
def test_whatever_is_proposed_in_whatever_scene_the_decision_is_valid_and_always_the_same(
    others: list[RobotView],
    ego: RobotView,
    capacity_bps: float,
    proposed: Any,
    available: tuple[str, ...],
    q_min: float,
) -> None:
    known = knowledge(available, q_min=q_min)
    shot = snapshot(ego, *others, capacity_bps=capacity_bps)
    found = analyze(shot, known)
    policy = Saying(lambda: proposed)
    decision = plan(shot, found, policy, known, None, 1, NOW_NS)
    assert_valid(decision, found, known)
    assert decode(encode(decision), Decision) == decision
    assert plan(shot, analyze(shot, known), policy, known, None, 1, NOW_NS) == decision
    following = plan(shot, found, Coverage(), known, decision, 2, NOW_NS)
    assert_valid(following, found, known)
    assert following.source == "policy"
    assert following.repairs == ()


def test_planning_changes_nothing_that_it_was_given() -> None:
    before = [c.area.copy() for c in (FLOOR.ego, *FLOOR.candidates)]
    decide(Coverage())
    for old, now in zip(before, (FLOOR.ego, *FLOOR.candidates), strict=True):
        assert np.array_equal(old, now.area)
