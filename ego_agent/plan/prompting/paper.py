"""A prompt in the manner of the paper, as a reference beside our own (prompt.py).

It tells each robot's place and heading and, one by one, all objects that it sees, as CoAdapt does,
and leaves it to the model to compare them. Rules, schema and reading of the answer are ours.
docs/prompt.md says how the two differ.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from ego_agent.knowledge.base import CycleResult, Knowledge
from ego_agent.knowledge.model import Candidate, UnifiedScene
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.prompting.fingerprint import scene_fingerprint
from ego_agent.plan.prompting.prompt import LlmPrompt, before, check_ego, median_size, template
from ego_agent.plan.prompting.schema import answer_schema, choices
from ego_agent.plan.prompting.table import nameable, usable
from swarm.messages import Algorithm, ChatMessage, Decision

MAX_ROBOTS = 64
MAX_OBJECTS = 32
"""Of one robot, those that it sees best: with MAX_ROBOTS they stay well below what a message may
hold."""
MAX_PAIRED = 10
"""Robots between which distances are told; of more the list would be longer than the scene."""
COMPASS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")
_WORDS = {
    "early": "raw points; the most precise, and the most bytes",
    "intermediate": "feature maps; between the two others",
    "late": "boxes of objects; the least precise, and hardly any bytes",
}
"""By the first part of an algorithm's name."""


def make_paper_prompt(
    scene: UnifiedScene,
    knowledge: Knowledge,
    previous: Decision | None,
    result: CycleResult | None,
    *,
    scorer: Scorer | None = None,
) -> LlmPrompt:
    """The question that a scene poses, as `make_prompt` makes it, in the paper's manner."""
    check_ego(scene)
    scorer = scorer or Scorer(scene, knowledge)
    listed = [c for c in scene.candidates if nameable(c.robot)][:MAX_ROBOTS]
    robots = [c.robot for c in listed if any(usable(scorer, c.robot, a) for a in c.sizes)]
    # An answer to our own prompt in the same scene is no answer to this one.
    own = hashlib.sha256(f"paper {scene_fingerprint(scorer)}".encode()).hexdigest()
    return LlmPrompt(
        messages=(
            ChatMessage(role="system", content=_system(knowledge)),
            ChatMessage(role="user", content=_user(scorer, listed, previous, result)),
        ),
        schema=answer_schema(choices(scorer, robots), knowledge.best_algorithm()),
        fingerprint=own,
        candidates=tuple(robots),
        ego=scene.ego.robot,
    )


def _system(knowledge: Knowledge) -> str:
    lines = [f"{name}: {_words(name)}." for name in knowledge.algorithms]
    return template("paper-system").substitute(algorithms="\n".join(lines))


def _words(name: Algorithm) -> str:
    paradigm, _, kind = name.partition("-")
    words = _WORDS.get(paradigm, "a form of its own")
    return f"{kind} {words}" if kind else words


def _user(
    scorer: Scorer,
    listed: Sequence[Candidate],
    previous: Decision | None,
    result: CycleResult | None,
) -> str:
    scene, objective = scorer.scene, scorer.objective
    sizes = {name: median_size(scorer, name) for name in scorer.knowledge.algorithms}
    costs = [f"{name} {'-' if kB is None else f'{kB / 1e3:.1f}'}" for name, kB in sizes.items()]
    lines = list(_robot(scene, scene.ego))
    for candidate in listed:
        lines += _robot(scene, candidate)
    return template("paper-user").substitute(
        ego=scene.ego.robot,
        range=f"{objective.comm_range_m:.0f}",
        bandwidth=f"{scene.capacity_bps / 1e6:.1f}",
        rate=f"{objective.rate_hz:g}",
        costs=", ".join(costs),
        robots="\n".join(lines),
        between=_between(listed[:MAX_PAIRED]),
        before=before(scorer, previous, result),
    )


def _robot(scene: UnifiedScene, robot: Candidate) -> Iterator[str]:
    """Its line, and one for each object that it sees, the nearest to it first."""
    pose = robot.pose
    facts = [
        f"{robot.robot} ({'ego' if robot is scene.ego else 'in range'})",
        f"x={pose.x:.1f} y={pose.y:.1f} heading={math.degrees(pose.heading):.0f} deg",
    ]
    if robot is not scene.ego:
        own = scene.ego.pose
        facts += [f"{robot.distance_m:.1f} m to the {direction(pose.x - own.x, pose.y - own.y)}"]
    yield ", ".join(facts)
    evidence = np.asarray(robot.evidence)
    best = np.argsort(-evidence, kind="stable")[:MAX_OBJECTS]
    away = np.hypot(*(scene.objects[:, :2] - [pose.x, pose.y]).T)
    for at in sorted((i for i in best if evidence[i] > 0), key=lambda i: (float(away[i]), int(i))):
        x, y, z = scene.objects[at].tolist()
        yield (
            f"  object {at + 1}: x={x:.1f} y={y:.1f} z={z:.1f}, {away[at]:.0f} m away, "
            f"seen {evidence[at]:.2f}"
        )


def direction(x: float, y: float) -> str:
    """Of a vector from the ego, one of eight; x points east.

    >>> direction(1.0, 0.1), direction(-2.0, -2.0)
    ('east', 'south-west')
    """
    return COMPASS[round(math.atan2(y, x) / math.tau * len(COMPASS)) % len(COMPASS)]


def _between(listed: Sequence[Candidate]) -> str:
    """How far robots are from each other; nothing where there are not two."""
    told = [
        f"{a.robot}-{b.robot} {math.hypot(a.pose.x - b.pose.x, a.pose.y - b.pose.y):.0f} m"
        for a, b in combinations(listed, 2)
    ]
    return f"Between robots: {', '.join(told)}." if told else "Between robots: nothing to tell."
