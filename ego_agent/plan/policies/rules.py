"""The rule-based baseline of the CoAdapt paper.

Facts from the published `coadapt/run_rulebased_selection.py`: tiers of 5, 20 and 50 Mbit/s with
thresholds half-way; in the low tier late fusion, else intermediate; the ego and the K nearest in
range, K = 3 by default.
"""

from __future__ import annotations

from dataclasses import dataclass

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from swarm.messages import Algorithm, Decision

LOW_TIER_BPS = 12.5e6
"""Half-way between the low (5 Mbit/s) and the medium tier (20 Mbit/s)."""


@dataclass(frozen=True)
class Rules:
    """Late fusion on a slow link, else intermediate; the nearest robots."""

    name: str = "rules"
    nearest: int = 3

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """The ego and its nearest candidates; intermediate is proposed even where it cannot be
        fused, and then replaced by validation."""
        algorithm: Algorithm = "late" if scene.capacity_bps < LOW_TIER_BPS else "intermediate"
        chosen = scene.candidates[: self.nearest]
        return Proposal(
            participants=(scene.ego.robot, *(c.robot for c in chosen)),
            algorithm=algorithm,
            reason=(
                f"Rules: {scene.capacity_bps / 1e6:.1f} Mbit/s, {algorithm} fusion, "
                f"{len(chosen)} nearest of {len(scene.candidates)} in range."
            ),
            source="policy",
        )


POLICIES = (Rules,)
