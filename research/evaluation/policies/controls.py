"""Controls: what a policy's choice is worth beside choices of as many that know less.

A policy decides how many take part, how, and who. Its two controls keep how many and how, on the
same link, so that only *who* differs: drawn at random, and the first by coverage gained.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.scoring import Scorer
from research.evaluation.policies.decide import Decided, having_placed, is_blind
from research.evaluation.windows.announcements import Announced, snapshot
from research.evaluation.windows.choice import Choice
from research.evaluation.windows.measure import candidates_of
from research.evaluation.windows.placed import Placed
from research.evaluation.windows.scenarios import Scenario
from swarm.messages import Algorithm

AT_RANDOM, FIRST = "~random", "~first"
"""What follows a policy's name in those of its controls."""
RANDOM_JUDGED = "random-judged"
"""The control of language models (guessing.py)."""
CONTROL = "control"
"""The source of their decisions."""
DRAWS = 100
"""Of one random set, until the link carries it."""


def is_control(policy: str) -> bool:
    """Whether that is the name of a control, not of a policy that is compared."""
    return policy.endswith((AT_RANDOM, FIRST)) or policy == RANDOM_JUDGED


def controls(
    scenario: Scenario,
    heard: Sequence[Announced],
    knowledge: Knowledge,
    decided: Sequence[Decided],
    placed: Sequence[Placed] = (),
) -> list[Decided]:
    """Both controls of one policy's decisions, one for each window that was `heard`.

    `placed`: as in `decisions`. None for policies that are measured as they propose, and for
    controls. Equal arguments give equal draws.
    """
    found = []
    for one, messages in zip(decided, heard, strict=True):
        if is_blind(one.policy) or is_control(one.policy):
            continue
        known_bps = scenario.known_bps(one.window)
        known = having_placed(knowledge, placed, one.window)
        scorer = Scorer(analyze(snapshot(one.ego, messages, known_bps), known), known)
        rng = random.Random(f"{scenario.name} {one.window} {one.policy}")
        found.append(_instead(one, AT_RANDOM, scorer, at_random(scorer, one.choice, rng)))
        found.append(_instead(one, FIRST, scorer, first(scorer, one.choice)))
    return found


def at_random(scorer: Scorer, choice: Choice, rng: random.Random) -> tuple[str, ...]:
    """As many robots as the choice has, any that can send for its algorithm, all sets that the link
    carries being equally likely; where DRAWS draws find none, the last one without the largest."""
    able = [robot for robot in candidates_of(scorer.scene) if scorer.can(robot, choice.algorithm)]
    drawn: list[str] = []
    for _ in range(DRAWS):
        drawn = rng.sample(able, min(len(choice.participants), len(able)))
        if _bytes(scorer, drawn, choice.algorithm) <= scorer.budget_bytes:
            return tuple(drawn)
    drawn.sort(key=lambda robot: scorer.size(robot, choice.algorithm))
    while _bytes(scorer, drawn, choice.algorithm) > scorer.budget_bytes:
        drawn.pop()
    return tuple(drawn)


def first(scorer: Scorer, choice: Choice) -> tuple[str, ...]:
    """As many robots as the choice has, the largest gain of coverage first; then, where nobody
    adds any, the nearest. Fewer where the link carries no more of them."""
    count, algorithm = len(choice.participants), choice.algorithm
    if not count:
        return ()
    taken: list[str] = []
    spent = 0
    for robot in _in_order(scorer, scorer.scene, algorithm):
        size = scorer.size(robot, algorithm)
        if len(taken) < count and spent + size <= scorer.budget_bytes:
            taken.append(robot)
            spent += size
    return tuple(taken)


def _in_order(scorer: Scorer, scene: UnifiedScene, algorithm: Algorithm) -> Iterator[str]:
    """Robots that can send for the algorithm, each once: those that add coverage, then the rest."""
    before: set[str] = set()
    for score in grow(scorer, scene.candidates, algorithm, by_byte=False):
        (added,) = set(score.participants) - before
        before.add(added)
        yield added
    yield from (r for r in candidates_of(scene) if r not in before and scorer.can(r, algorithm))


def _instead(one: Decided, mark: str, scorer: Scorer, robots: Sequence[str]) -> Decided:
    choice = Choice.of(robots, one.choice.algorithm, one.ego)
    return replace(
        one,
        policy=f"{one.policy}{mark}",
        choice=choice,
        predicted_bytes=_bytes(scorer, choice.participants, one.choice.algorithm),
        reason=f"As many as {one.policy} chose.",
        source=CONTROL,
        decision_s=0.0,
        repairs=(),
        answered=None,
    )


def _bytes(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> int:
    return sum(scorer.size(robot, algorithm) for robot in robots)
