"""What stood to be chosen in a scene, for people and for experiments."""

from __future__ import annotations

import math
from typing import Any

from ego_agent.knowledge import Knowledge
from ego_agent.model import UnifiedScene
from ego_agent.scoring import Scorer


def explain(scene: UnifiedScene, knowledge: Knowledge) -> dict[str, Any]:
    """Plain values, ready for JSON: the budget in bytes a frame, the number of merged objects, each
    candidate's distance in metres, sizes in bytes, width of its own link in bit/s (None: as wide as
    the cell) and share of all that is seen (alone, and beyond
    what the ego sees), and why the others are excluded."""
    scorer = Scorer(scene, knowledge)
    ego_share = scorer.share([0])
    return {
        "budget_bytes": scorer.budget_bytes,
        "algorithms": {name: knowledge.factors[name] for name in knowledge.algorithms},
        "objects": len(scene.objects),
        "ego_share": round(ego_share, 4),
        "candidates": [
            {
                "robot": candidate.robot,
                "distance_m": round(candidate.distance_m, 2),
                "sizes": dict(candidate.sizes),
                "capacity_bps": candidate.capacity_bps
                if math.isfinite(candidate.capacity_bps)
                else None,
                "share": round(scorer.share([row]), 4),
                "adds_to_ego": round(scorer.share([0, row]) - ego_share, 4),
            }
            for row, candidate in enumerate(scene.candidates, start=1)
        ],
        "excluded": dict(scene.excluded),
    }
