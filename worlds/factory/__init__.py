"""A simulated factory floor: ray-cast LiDAR scans of shelving, machines, forklifts and workers."""

from __future__ import annotations

from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest


def _open(request: WorldRequest) -> World:
    from worlds.factory.world import FactoryWorld

    return FactoryWorld(
        robots=request.robots,
        seed=request.seed,
        rings=request.rings,
        room=request.room,
        scenario=request.scenario,
        cache=request.cache,
    )


WORLDS = (WorldKind("factory", _open, numbered=True, detector="factory"),)
