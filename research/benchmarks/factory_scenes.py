"""Unified scenes from simulated scans: what an ego would know if every message arrived at once."""

from __future__ import annotations

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from perception.fusion.registry import make_fusion
from research.evaluation.windows.announcements import heard, snapshot
from swarm.messages import ALGORITHMS
from worlds.base import World


def factory_scene(
    world: World, frame: int, ego: str, knowledge: Knowledge, capacity_bps: float
) -> UnifiedScene:
    """The scene of one frame, with real encoded sizes, as the ego would analyze it."""
    fusions = {name: make_fusion(name, world.detector) for name in ALGORITHMS}
    return analyze(snapshot(ego, heard(world, frame, ego, fusions), capacity_bps), knowledge)
