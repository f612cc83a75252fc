"""Baselines that always take everyone in range, with one algorithm."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from perception.fusion.algorithms import all_fusions
from swarm.messages import Algorithm, Decision


@dataclass(frozen=True)
class Static:
    """Everyone in range, always with the same algorithm; blind to the link."""

    requires: Algorithm

    @property
    def name(self) -> str:
        """`static-` and the algorithm."""
        return f"static-{self.requires}"

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """All candidates."""
        return Proposal(
            participants=(scene.ego.robot, *(c.robot for c in scene.candidates)),
            algorithm=self.requires,
            reason=f"Static: all {len(scene.candidates)} robots in range, {self.requires} fusion.",
            source="policy",
        )


POLICIES = tuple(partial(Static, algorithm) for algorithm in all_fusions())
