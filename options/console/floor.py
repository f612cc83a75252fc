"""The floor plan behind the map, where the world is a simulated factory, and names of places."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from options.console.answers import Floor
from swarm.messages import Place
from swarm.site_file import read_site
from worlds.factory.layout import build_floor
from worlds.factory.places import named_places

MIN_AREA_M2 = 0.2
"""Smaller footprints (uprights, legs) are not drawn; pillars have 0.25 m2."""
LOW_M = 1.0
"""Neither is what stands on something else."""


def plan(world: str, robots: int, seed: int, site: str = "") -> Floor:
    """The footprints of what stands still; places are those of the site file, else the world's own.

    Raises SettingError for a site file that is none.
    """
    places = read_site(Path(site)) if site else ()
    if world != "factory":
        return Floor(width_m=None, depth_m=None, rects=(), places=places)
    # As `FactoryWorld` lays it out: the floor is the first that its generator makes.
    floor = build_floor(robots, np.random.default_rng(seed))
    low, high = floor.boxes[:, :3], floor.boxes[:, 3:]
    area = (high[:, 0] - low[:, 0]) * (high[:, 1] - low[:, 1])
    shown = (area >= MIN_AREA_M2) & (low[:, 2] < LOW_M)
    rects = np.unique(np.round(np.hstack([low[shown, :2], high[shown, :2]]), 2), axis=0)
    if not site:
        places = tuple(Place(name, polygon) for name, polygon in named_places(floor))
    return Floor(
        width_m=floor.width_m,
        depth_m=floor.depth_m,
        rects=tuple(map(tuple, rects.tolist())),
        places=places,
    )
