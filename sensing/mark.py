"""The mark of the world that a process lives in, by which others see whether it is theirs."""

from __future__ import annotations

from swarm.fitting import write_mark
from swarm.process import ProcessSettings
from worlds.base import World
from worlds.registry import world_kind


def mark_of(settings: ProcessSettings, world: World) -> str:
    """What must be the same for two processes to see the same things at the same time.

    A robot's LiDAR, or a part of recorded data, may be its own. Of a live world only the kind
    counts: its robots share the real one. Raises WorldError for an unknown world.
    """
    kind = world_kind(settings.world)
    facts: dict[str, object] = {"detector": world.detector}
    if kind.data != "address":
        facts["epoch"] = settings.epoch_ns
    if kind.numbered:
        facts |= {
            "robots": settings.world_robots,
            "scenario": settings.world_scenario,
            "seed": settings.world_seed,
        }
    elif kind.data != "address":
        facts["frames"] = world.frame_count
    return write_mark(kind.name, facts)
