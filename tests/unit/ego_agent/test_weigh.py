"""What a policy compared is what the journal tells, without comparing it anew."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace

import pytest

from ego_agent.knowledge.answers import AnswerTimes, Pool, Weighted
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import RARER_HZ, SLOWER_HZ
from ego_agent.plan.choices.explain import explain
from ego_agent.plan.choices.options import Compared, compare
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.weigh import weigh, weighings
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.base import Policy
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.policies.registry import make_policy
from swarm.messages import ALGORITHMS, Decision
from tests.support.ego_scenes import NOW_NS, snapshot
from tests.support.prompt_scenes import floor

SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class Failing:
    """A policy that is out of order."""

    name: str = "failing"

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        raise RuntimeError


def knowing(rarer_hz: tuple[float, ...], q_min: float = 0.7) -> Knowledge:
    objective = Objective(q_min=q_min, slower_hz=SLOWER_HZ, rarer_hz=rarer_hz)
    return Knowledge.of_detector("factory", objective, ALGORITHMS)


def decided(
    policy: Policy, scene: UnifiedScene, known: Knowledge, previous: Decision | None, now_ns: int
) -> tuple[Decision, list[Compared]]:
    compared: list[Compared] = []
    decision = plan(
        snapshot(ego="R1"), scene, policy, known, previous, 7, now_ns, on_compared=compared.append
    )
    return decision, compared


@pytest.mark.parametrize("rarer_hz", [(), RARER_HZ])
@pytest.mark.parametrize("policy", [Coverage(), make_policy("llm", ALGORITHMS), Failing()])
def test_what_was_compared_tells_the_same_as_comparing_it_anew(
    policy: Policy, rarer_hz: tuple[float, ...]
) -> None:
    rng = random.Random(11)
    previous: Decision | None = None
    others = 0
    for cycle in range(12):
        known = knowing(rarer_hz, rng.choice((0.0, 0.7, 0.95)))
        scene = floor(rng.randint(1, 24), known, 10 ** rng.uniform(4.5, 8.0))
        previous, compared = decided(policy, scene, known, previous, NOW_NS + cycle * SECOND_NS)
        assert len(compared) == 1
        anew = weigh(compare(Scorer(scene, known)), previous)
        assert weigh(compared[0], previous) == anew
        others += anew.other is not None
    assert others > 6


def test_a_policy_that_compares_otherwise_leaves_comparing_to_those_who_tell() -> None:
    known = knowing(())
    scene = floor(6, known)
    decision, compared = decided(make_policy("static-late", ALGORITHMS), scene, known, None, NOW_NS)
    assert compared == []
    assert weigh(compare(Scorer(scene, known)), decision).other is not None


@pytest.mark.parametrize("rarer_hz", [(), RARER_HZ])
def test_people_are_told_what_the_journal_holds(rarer_hz: tuple[float, ...]) -> None:
    known = knowing(rarer_hz)
    for capacity_bps in (1e5, 1e6, 2e7):
        scene = floor(9, known, capacity_bps)
        decision, compared = decided(Coverage(), scene, known, None, NOW_NS)
        weighed = weigh(compared[0], decision).robots
        told = {one["robot"]: one for one in explain(scene, known, decision)["candidates"]}
        assert len(weighed) == 8
        for robot, one in weighed.items():
            assert (told[robot]["adds"], told[robot]["costs"]) == (one.adds, one.costs)
            assert told[robot]["chosen"] == (robot in decision.participants)


@pytest.mark.parametrize("seed", range(6))
def test_what_each_robot_adds_is_what_scoring_the_choice_with_it_says(seed: int) -> None:
    rng = random.Random(seed)
    known = knowing(())
    usual = floor(16, known, 10 ** rng.uniform(5.0, 7.0))
    frames = rng.uniform(1.0, 4.0)
    late = AnswerTimes(own=Pool.of([Weighted(0.6, frames, frames)]), frames=9.0)
    scene = replace(
        usual,
        candidates=tuple(
            replace(one, answers={"early": late}) if rng.random() < 0.4 else one
            for one in usual.candidates
        ),
        preferred=frozenset({"R5", "R9"}),
    )
    decision, compared = decided(Coverage(), scene, known, None, NOW_NS)
    scorer = compared[0].scorer.at_rate(decision.rate_hz)
    chosen, found = weighings(scorer, decision)
    outside = [robot for robot in found if robot not in decision.participants]
    assert any(found[robot].adds for robot in outside)
    for robot in outside:
        if not scorer.can(robot, decision.algorithm):
            assert found[robot].adds is None
            continue
        joined = scorer.score([*chosen.participants, robot], decision.algorithm)
        assert found[robot].adds == pytest.approx(joined.quality - chosen.quality, abs=1e-4)
        assert found[robot].costs == pytest.approx(joined.cost - chosen.cost, abs=1e-4)
