"""A language model that knows nothing: the control of language models.

It may say what a grammar would let a model say, and is checked, repaired and judged as a model is.
What a model is worth beyond it is the model's own.
"""

from __future__ import annotations

import json
import random
from math import comb

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.prompting.schema import choices
from ego_agent.plan.prompting.table import ranked
from llm_gateway.model import Prompt
from research.evaluation.policies.advice import AdvisedAtOnce, Answer
from research.evaluation.policies.controls import DRAWS, RANDOM_JUDGED
from swarm.messages import Decision


class RandomJudged:
    """Any set and algorithm that the link carries, through the judge that advice goes through; what
    `coverage` decides where that refuses them."""

    name = RANDOM_JUDGED

    def __init__(self, seed: int) -> None:
        self._guesses = _Guesses(seed)
        self._policy = AdvisedAtOnce(self._guesses)

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """A new draw each time; equal seeds draw alike."""
        self._guesses.scorer = Scorer(scene, knowledge)
        return self._policy.propose(scene, knowledge, previous)


class _Guesses:
    """Implements `Adviser`."""

    name = RANDOM_JUDGED

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self.scorer: Scorer | None = None
        """Of the scene that is asked about."""

    def ask(self, prompt: Prompt) -> Answer:
        """All pairs of a set and an algorithm that the question's schema admits and the link
        carries are equally likely; where DRAWS draws find none that it carries, repair decides."""
        assert self.scorer is not None
        algorithm, helpers = drawn(self.scorer, self._random)
        said = {
            "algorithm": algorithm,
            "helpers": helpers,
            "confidence": "medium",
            "explanation": "Drawn at random.",
        }
        return Answer(json.dumps(said), "", 0.0)


def drawn(scorer: Scorer, rng: random.Random) -> tuple[str, list[str]]:
    """An algorithm and robots that a question in the scorer's scene admits."""
    admitted = choices(scorer, [entry.candidate.robot for entry in ranked(scorer)])
    sizes = [(one, k) for one in admitted for k in range(one.at_least, one.at_most + 1)]
    if not sizes:
        return scorer.knowledge.best_algorithm(), []
    weights = [comb(len(one.robots), k) for one, k in sizes]
    algorithm, robots = "", list[str]()
    for _ in range(DRAWS):
        ((one, k),) = rng.choices(sizes, weights)
        algorithm, robots = one.algorithm, rng.sample(one.robots, k)
        if sum(scorer.size(robot, algorithm) for robot in robots) <= scorer.budget_bytes:
            break
    return algorithm, robots
