"""The paper's three motivating snapshots, on scans: what the default policy makes of them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from research.evaluation.policies.decide import decisions, policy_of
from research.evaluation.policies.work_items import knowledge_of
from research.evaluation.windows import announcements
from research.evaluation.windows.measure import Window
from research.evaluation.windows.scenarios import factory_suite
from swarm.defaults import POLICY
from swarm.messages import ALGORITHMS

SNAPSHOTS = {one.name: replace(one, windows=1) for one in factory_suite() if one.expectation}


@pytest.mark.slow
@pytest.mark.parametrize("name", SNAPSHOTS)
def test_the_default_policy_decides_as_the_paper_expects(name: str) -> None:
    scenario = SNAPSHOTS[name]
    knowledge, window = knowledge_of(ALGORITHMS, scenario), Window(scenario, 0)
    heard = announcements.heard(
        window.world,
        scenario.decision_frame(0),
        window.ego,
        {algorithm: window.fusion(algorithm) for algorithm in ALGORITHMS},
        scenario.pose_noise_m,
    )
    (one,) = decisions(scenario, [heard], knowledge, policy_of(POLICY, scenario, knowledge))
    feasible = one.predicted_bytes * 8 * knowledge.objective.rate_hz <= scenario.capacity_bps(0)
    assert scenario.expectation is not None
    assert scenario.expectation.met(one.choice.participants, feasible), one.reason
    assert set(one.choice.participants) < set(one.in_range), "somebody adds nothing worth asking"


def test_there_are_three() -> None:
    assert len(SNAPSHOTS) == 3
