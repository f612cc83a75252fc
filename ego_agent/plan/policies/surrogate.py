"""The choice with the best predicted value, by a network that has learnt from measured choices.

docs/evaluation.md says how it was trained.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.plan.choices.hysteresis import best_option, settle, still_possible
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.surrogate.estimate import Estimate
from ego_agent.plan.surrogate.model import Surrogate, packaged_surrogate
from ego_agent.settings import EgoSettings
from swarm.messages import Decision


@dataclass(frozen=True)
class BySurrogate:
    """Maximises the surrogate's Q - lambda C within Q_min and the link; slow to change its mind."""

    name: str = "surrogate"
    model: Surrogate | None = field(default=None, repr=False)
    """The one that comes with the project where None."""

    def prepare(self, settings: EgoSettings) -> None:
        """Reads the surrogate. Raises DecisionError where that cannot be done."""
        if self.model is None:
            packaged_surrogate()

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """The best option that was found, or the decision in force if that is as good.

        Raises DecisionError where there is no surrogate.
        """
        scorer = Scorer(scene, knowledge)
        estimate = Estimate(scorer, self.model or packaged_surrogate())
        options = list(estimate.options())
        best = best_option(scorer, options)
        held = still_possible(scorer, previous)
        if (
            previous is not None
            and held is not None
            and (not held.participants or held.algorithm in estimate.algorithms)
        ):
            held = estimate.score(held.participants, held.algorithm)
            best = settle(scorer, options, best, held, previous)
        return Proposal(
            participants=(scene.ego.robot, *best.participants),
            algorithm=best.algorithm,
            reason=_reason(scorer, best, kept=best is held),
            source="policy",
        )


def _reason(scorer: Scorer, score: Score, *, kept: bool) -> str:
    return (
        f"The surrogate expects AP@0.7 {score.quality:.2f} of the ego and "
        f"{len(score.participants)} of {len(scorer.scene.candidates)} robots in range with "
        f"{score.algorithm} fusion, for {score.cost_bytes / 1e3:.1f} of "
        f"{scorer.budget_bytes / 1e3:.1f} kB a frame{'; kept, no change pays.' if kept else '.'}"
    )


POLICIES = (BySurrogate,)
