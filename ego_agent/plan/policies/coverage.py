"""The deterministic policy of the product, and the fallback of every other one.

Robots join greedily, best marginal coverage first, while the link can carry them. Every set on the
way is an option, for each algorithm; the best option wins, unless the decision in force is as good.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.plan.assign import told as told_rates
from ego_agent.plan.choices.explain import told
from ego_agent.plan.choices.hysteresis import best_option, settle, still_possible
from ego_agent.plan.choices.options import Compared, compare
from ego_agent.plan.choices.scoring import Score, Scorer
from swarm.messages import MIXED, Decision


@dataclass(frozen=True)
class Coverage:
    """Maximises Q - lambda C within Q_min and the link; slow to change its mind."""

    name: str = "coverage"

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """The best option that was found, or the decision in force if that is as good."""
        compared = compare(Scorer(scene, knowledge))
        best, reason = self.choose_among(compared, previous)
        return Proposal(
            participants=(scene.ego.robot, *best.participants),
            algorithm=best.algorithm,
            reason=reason,
            source="policy",
            rate_hz=best.pace.rate_hz,
            assignments=best.assignments,
            compared=compared,
        )

    def choose(self, scorer: Scorer, previous: Decision | None) -> tuple[Score, str]:
        """The same as a score, and its reason."""
        return self.choose_among(compare(scorer), previous)

    def choose_among(self, compared: Compared, previous: Decision | None) -> tuple[Score, str]:
        """The same of choices that have been compared already."""
        scorer, options = compared.scorer, compared.options
        best = best_option(scorer, options)
        held = still_possible(scorer, previous, compared.mixes)
        if held is not None and previous is not None:
            best = settle(scorer, options, best, held, previous)
        return best, reason_of(scorer, best, kept=best is held)


def reason_of(scorer: Scorer, score: Score, *, kept: bool) -> str:
    """What is known of a choice, in one sentence for people."""
    at = scorer.at(score.pace)
    rows = [0, *(scorer.row_of[robot] for robot in score.participants)]
    share = at.share(rows, score.algorithm if score.algorithm != MIXED else None)
    text = (
        f"The ego and {len(score.participants)} of {len(scorer.scene.candidates)} robots in range "
        f"see {100 * share:.0f} % of what all see{_expected(scorer, score)}; "
        f"{_forms(score)} fusion costs "
        f"{score.cost_bytes / 1e3:.1f} of {at.budget_bytes / 1e3:.1f} kB a frame"
    )
    if score.pace != scorer.paces[0]:
        text += f" at {score.pace.rate_hz:g} frames a second"
    if late := told(at):
        text += f"; {late}"
    if not scorer.good_enough(score):
        text += f"; {score.quality:.2f} is the best quality, below {scorer.objective.q_min:.2f}"
    text += "; kept, no change pays." if kept else "."
    return f"{text} {told_rates(score.assignments, score.pace.rate_hz)}".rstrip()


def _forms(score: Score) -> str:
    """What is fused, and of how many where that differs."""
    if score.algorithm != MIXED:
        return score.algorithm
    counts = Counter(one.algorithm for one in score.assignments)
    return "mixed (" + ", ".join(f"{count} {name}" for name, count in counts.items()) + ")"


def _expected(scorer: Scorer, score: Score) -> str:
    if not scorer.knowledge.quality.calibrated:
        return ""
    return f", AP@0.7 {score.quality:.2f} is expected"


POLICIES = (Coverage,)
