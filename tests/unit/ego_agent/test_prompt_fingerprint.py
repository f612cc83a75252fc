from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from ego_agent.knowledge.model import Candidate, UnifiedScene
from ego_agent.plan.prompting import fingerprint, make_prompt
from ego_agent.plan.prompting.fingerprint import STEP_M
from tests.support.ego_scenes import knowledge
from tests.support.prompt_scenes import floor

KNOWN = knowledge()
FLOOR = floor(6, KNOWN, 20e6)


def moved(found: UnifiedScene, **changes: float) -> UnifiedScene:
    """With its first candidate's pose changed."""
    first, *others = found.candidates
    pose = dataclasses.replace(first.pose, **changes)
    return dataclasses.replace(found, candidates=(dataclasses.replace(first, pose=pose), *others))


def jittered(found: UnifiedScene, rng: np.random.Generator) -> UnifiedScene:
    """Poses off by 5 cm and 1 degree, sizes by 3 %, capacity by 2 %."""

    def shake(robot: Candidate) -> Candidate:
        pose = robot.pose
        return dataclasses.replace(
            robot,
            pose=dataclasses.replace(
                pose,
                x=pose.x + rng.normal(0, 0.05),
                y=pose.y + rng.normal(0, 0.05),
                yaw=pose.yaw + rng.normal(0, 0.02),
            ),
            sizes={name: round(n * rng.normal(1, 0.03)) for name, n in robot.sizes.items()},
        )

    return dataclasses.replace(
        found,
        ego=shake(found.ego),
        candidates=tuple(map(shake, found.candidates)),
        capacity_bps=found.capacity_bps * rng.normal(1, 0.02),
    )


def test_it_is_the_one_of_the_prompt_and_fits_the_message() -> None:
    found = fingerprint(FLOOR, KNOWN)
    assert re.fullmatch("[0-9a-f]{64}", found)
    assert found == make_prompt(FLOOR, KNOWN, None, None).fingerprint


def test_small_jitter_mostly_leaves_it_as_it_is() -> None:
    rng = np.random.default_rng(1)
    same = [
        fingerprint(jittered(FLOOR, rng), KNOWN) == fingerprint(FLOOR, KNOWN) for _ in range(50)
    ]
    assert sum(same) >= 40


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, 3 * math.pi / 2])
def test_headings_along_the_aisles_are_amid_a_step(heading: float) -> None:
    low, high = (moved(FLOOR, yaw=heading + off) for off in (-0.3, 0.3))
    assert fingerprint(low, KNOWN) == fingerprint(high, KNOWN)


def with_objects(found: UnifiedScene, count: int) -> UnifiedScene:
    def shown(robot: Candidate) -> Candidate:
        return dataclasses.replace(robot, evidence=np.zeros(count, np.float32))

    return dataclasses.replace(
        found,
        ego=shown(found.ego),
        candidates=tuple(shown(robot) for robot in found.candidates),
        objects=np.zeros((count, 3), np.float32),
    )


def test_whatever_matters_changes_it() -> None:
    x = FLOOR.candidates[0].pose.x
    others = [
        moved(FLOOR, x=x + STEP_M),
        moved(FLOOR, yaw=math.pi / 2),
        dataclasses.replace(FLOOR, candidates=FLOOR.candidates[1:]),
        with_objects(FLOOR, 99),
        dataclasses.replace(FLOOR, ego=dataclasses.replace(FLOOR.ego, robot="R9")),
        *(dataclasses.replace(FLOOR, capacity_bps=bps) for bps in (1.0, 5e6, 55e6, 1e9)),
    ]
    found = [fingerprint(FLOOR, KNOWN), *(fingerprint(other, KNOWN) for other in others)]
    found.append(fingerprint(FLOOR, knowledge(q_min=0.6)))
    found.append(fingerprint(FLOOR, knowledge(["late"])))
    assert len(set(found)) == len(found)


def test_a_link_that_carries_everything_may_carry_more() -> None:
    wide, wider = (dataclasses.replace(FLOOR, capacity_bps=bps) for bps in (1e9, 5e9))
    assert fingerprint(wide, KNOWN) == fingerprint(wider, KNOWN)


def test_the_order_of_robots_does_not_matter() -> None:
    turned = dataclasses.replace(FLOOR, candidates=FLOOR.candidates[::-1])
    assert fingerprint(turned, KNOWN) == fingerprint(FLOOR, KNOWN)
