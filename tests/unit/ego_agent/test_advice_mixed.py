"""Advice in which robots send different things: judged, decided, held and told."""

from __future__ import annotations

import json

import pytest

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import RARER_HZ, SLOWER_HZ
from ego_agent.plan.advice.judge import Advised, repaired
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.validation import Unusable, validate
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting.letters import Groups, short_answer
from ego_agent.plan.prompting.short import groups_of, make_short_prompt, short_scene
from llm_gateway.model import Prompt
from research.evaluation.policies.advice import AdvisedAtOnce, Answer
from swarm.messages import ALGORITHMS, MIXED, Decision
from tests.support.prompt_scenes import floor

RATES_BPS = (1e6, 2e6, 3e6, 5e6, 7e6, 10e6, 15e6, 20e6, 30e6)


def live(**aims: float) -> Knowledge:
    """As an ego of a swarm in the factory."""
    objective = Objective(slower_hz=SLOWER_HZ, rarer_hz=RARER_HZ, **aims)
    return Knowledge.of_detector("factory", objective)


class Saying:
    """A language model that always says the same."""

    name = "saying"

    def __init__(self, text: str) -> None:
        self.text = text

    def ask(self, prompt: Prompt) -> Answer:
        return Answer(self.text, "", 0.1)


@pytest.fixture(scope="module")
def mixed() -> tuple[UnifiedScene, Score, Groups]:
    """A scene in which `coverage` lets robots send different things, and the answer that does."""
    for rate_bps in RATES_BPS:
        found = floor(7, live(), rate_bps)
        scorer = Scorer(found, live())
        best, _ = Coverage().choose(scorer, None)
        groups = groups_of(short_scene(scorer), best)
        if best.algorithm == MIXED and groups is not None:
            return found, best, groups
    raise AssertionError("coverage mixes at none of these rates")


def decided(policy: AdvisedAtOnce, found: UnifiedScene, previous: Decision | None) -> Decision:
    proposal = policy.propose(found, live(), previous)
    decision = validate(proposal, found, live(), policy="llm", cycle=1, now_ns=0)
    assert not isinstance(decision, Unusable)
    return decision


def test_each_robot_sends_what_the_answer_says(mixed: tuple[UnifiedScene, Score, Groups]) -> None:
    found, best, groups = mixed
    policy = AdvisedAtOnce(Saying(json.dumps(short_answer(groups))), "short")
    decision = decided(policy, found, None)
    assert (decision.source, decision.algorithm, decision.repairs) == ("llm", MIXED, ())
    sends = {one.robot: one.algorithm for one in decision.assignments}
    assert sends == {robot: best.algorithm_of(robot) for robot in best.participants}
    assert decision.reason.count("Memory carries on") <= 1
    again = decided(policy, found, decision)
    assert (again.source, again.assignments) == ("llm", decision.assignments)


def test_unknown_robots_are_dropped_and_told(mixed: tuple[UnifiedScene, Score, Groups]) -> None:
    found, best, _ = mixed
    scorer = Scorer(found, live())
    forms = {robot: best.algorithm_of(robot) for robot in best.participants}
    named = ("R1", *forms, "R99")
    verdict = repaired(Advised(named, MIXED, {**forms, "R99": "late"}), scorer)
    assert (verdict.refused, verdict.repaired) == (None, ("unknown_robot",))
    assert verdict.notes == ("dropped 'R99': no such robot is known",)
    assert verdict.forms == forms
    nobody = repaired(Advised(("R1", "R98", "R99"), MIXED, {"R98": "early", "R99": "late"}), scorer)
    assert nobody.refused == "unknown_robot"


@pytest.mark.parametrize(
    "known",
    [
        Knowledge.of_detector("factory", Objective(slower_hz=SLOWER_HZ)),
        Knowledge.of_detector("factory", Objective(rarer_hz=RARER_HZ), mixable=()),
    ],
)
def test_where_robots_may_not_differ_they_send_the_same(
    known: Knowledge, mixed: tuple[UnifiedScene, Score, Groups]
) -> None:
    found, best, _ = mixed
    forms = {robot: best.algorithm_of(robot) for robot in best.participants}
    verdict = repaired(Advised(("R1", *forms), MIXED, forms), Scorer(found, known))
    assert verdict.refused is None
    assert "infeasible" in verdict.repaired
    assert verdict.forms == {}
    answers = json.loads(make_short_prompt(found, known, None, None).schema)["enum"]
    assert all(sum(name in answer for name in ALGORITHMS) <= 1 for answer in answers)
