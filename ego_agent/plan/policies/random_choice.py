"""Chance: the least that any policy must beat."""

from __future__ import annotations

import random

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from swarm.messages import Decision


class Chance:
    """Any algorithm and any set of candidates, all equally likely; blind to the link."""

    name = "random"

    def __init__(self, seed: int = 0) -> None:
        self._random = random.Random(seed)

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """A new draw each time; equal seeds draw alike."""
        chosen = [c.robot for c in scene.candidates if self._random.random() < 0.5]
        algorithm = self._random.choice(knowledge.algorithms)
        return Proposal(
            participants=(scene.ego.robot, *chosen),
            algorithm=algorithm,
            reason=f"Chance: {len(chosen)} of {len(scene.candidates)} robots, {algorithm} fusion.",
            source="policy",
        )


POLICIES = (Chance,)
