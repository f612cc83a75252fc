"""Rates: what is planned is what the frames of a sensor come to."""

from __future__ import annotations

import msgspec
import pytest

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.pace import due, paces, stride
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.settings import EgoSettings
from swarm.messages import Assignment
from tests.support.ego_scenes import BOTH, NOW_NS, candidate, scene, snapshot

FRAMES = 2_000
"""Of a sensor, so many that every rate comes out even to a hundredth."""


@pytest.mark.parametrize("sensor_hz", [4.0, 5.0, 8.0, 10.0, 12.5, 20.0])
def test_rates_that_are_decided_among_are_those_that_frames_come_to(sensor_hz: float) -> None:
    settings = EgoSettings()
    objective = settings.objective(60.0, sensor_hz)
    knowledge = Knowledge.of_detector("factory", objective, BOTH)
    robots = candidate("R1", cells=range(8)), candidate("R2", cells=range(4, 16))
    scorer = Scorer(scene(*robots), knowledge)
    nobody = plan(snapshot(ego="R1"), scorer.scene, Coverage(), knowledge, None, 7, NOW_NS)
    for pace in paces(objective):
        options = Mixes(scorer.at_rate(pace.rate_hz)).options
        assert len({(o.algorithm, o.rate_hz) for o in options}) == len(options)
        for option in options:
            asked = Assignment(robot="R2", algorithm=option.algorithm, rate_hz=option.rate_hz)
            decision = msgspec.structs.replace(
                nobody, rate_hz=pace.rate_hz, participants=("R1", "R2"), assignments=(asked,)
            )
            step = stride(decision, sensor_hz, settings.fusion_rate_hz)
            fused = [frame // step for frame in range(0, FRAMES, step)]
            seconds = FRAMES / sensor_hz
            assert len(fused) / seconds == pytest.approx(pace.rate_hz, rel=0.01)
            came = sum(due(decision, "R2", number) for number in fused)
            assert came / seconds == pytest.approx(option.rate_hz, rel=0.02)
