"""A simulated town: ray-cast LiDAR scans of streets as OPV2V's recording cars see CARLA's."""

from __future__ import annotations

from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest


def _open(request: WorldRequest) -> World:
    from worlds.road.world import RoadWorld

    return RoadWorld(robots=request.robots, seed=request.seed, cache=request.cache)


WORLDS = (WorldKind("road", _open, numbered=True, detector="road"),)
