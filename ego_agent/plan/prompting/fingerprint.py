"""One short name for all scenes that are nearly the same.

An answer for a scene of the same fingerprint may be given again; whoever takes it checks it against
the scene as it is.
"""

from __future__ import annotations

import hashlib
import math

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Candidate, UnifiedScene
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.prompting.arrival import mostly_late

VERSION = 1
STEP_M = 8.0
HEADING_STEPS = 8
"""Of a full turn: 45 degrees each."""
OBJECTS_STEP = 2.0
SIZES_STEP = 2.0
CAPACITY_STEP = 1.5
"""Factors from one step to the next."""


def fingerprint(scene: UnifiedScene, knowledge: Knowledge) -> str:
    """SHA-256 of the quantised scene, hexadecimal."""
    return scene_fingerprint(Scorer(scene, knowledge))


def scene_fingerprint(scorer: Scorer) -> str:
    """The same, where there is a scorer already."""
    scene, knowledge = scorer.scene, scorer.knowledge
    robots = sorted(scene.candidates, key=lambda c: c.robot)
    quantised = [
        VERSION,
        scene.ego.robot,
        knowledge.objective,
        knowledge.quality,
        knowledge.algorithms,
        _robot(scorer, scene.ego),
        [_robot(scorer, candidate) for candidate in robots],
        _step(len(scene.objects), OBJECTS_STEP),
        _capacity(scorer),
    ]
    if late := [name for name in knowledge.algorithms if mostly_late(scorer, name)]:
        quantised.append(late)
    return hashlib.sha256(msgspec.json.encode(quantised)).hexdigest()


def _robot(scorer: Scorer, robot: Candidate) -> list[object]:
    """Where it is, and what can be had from it."""
    pose = robot.pose
    return [
        robot.robot,
        *(math.floor(way / STEP_M) if math.isfinite(way) else 0 for way in (pose.x, pose.y)),
        # Headings along the axes, the usual ones in aisles, lie amid a step.
        round(pose.heading / math.tau * HEADING_STEPS) % HEADING_STEPS,
        [scorer.can(robot.robot, name) for name in scorer.knowledge.algorithms],
    ]


def _capacity(scorer: Scorer) -> list[object]:
    """The budget in steps, up to where it carries everything in every form; and for each algorithm
    what all need, and whether the budget carries anyone, and everyone."""
    needs = [
        [c.sizes[name] for c in scorer.scene.candidates if scorer.can(c.robot, name)]
        for name in scorer.knowledge.algorithms
    ]
    budget = scorer.budget_bytes
    enough = max(map(sum, needs), default=0)
    return [
        _step(budget, CAPACITY_STEP) if budget < enough else "enough",
        [
            [_step(sum(sizes), SIZES_STEP), min(sizes, default=0) <= budget, sum(sizes) <= budget]
            for sizes in needs
        ],
    ]


def _step(value: float, factor: float) -> int:
    """The number of the step, by factors, that a value lies in; -1 for 0."""
    return math.floor(math.log(value, factor)) if value >= 1.0 else -1
