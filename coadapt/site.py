"""What a swarm's site calls its places and classes."""

from __future__ import annotations

from pathlib import Path

from deploy.spec import SwarmSpec
from swarm.messages import Place
from swarm.site_file import read_site, write_site

FILE = "site.json"


def site_file_of(spec: SwarmSpec) -> Path:
    """Where `up` puts the site file that it brings."""
    return Path(spec.var_dir) / FILE


def bring_site(spec: SwarmSpec) -> Path | None:
    """Writes the site file of a world that knows its own layout; None for another one. Raises
    OSError."""
    places = _known_places(spec)
    if not places:
        return None
    path = site_file_of(spec)
    write_site(path, places)
    return path


def places_of(path: Path | None, spec: SwarmSpec) -> tuple[Place, ...]:
    """The places of a site file; without one those of the swarm's world, as far as it knows any.
    Raises SettingError."""
    return _known_places(spec) if path is None else read_site(path)


def classes_of(spec: SwarmSpec) -> tuple[str, ...]:
    """What the detector of a swarm's world tells apart, robots aside: they are known."""
    from perception.detector.grid import bev_config
    from swarm.errors import PerceptionError

    try:
        labels = bev_config(spec.world).labels
    except PerceptionError:
        return ()
    return tuple(label for label in labels if label != "robot")


def _known_places(spec: SwarmSpec) -> tuple[Place, ...]:
    if spec.world != "factory":
        return ()
    # Only here: most commands need no world.
    import numpy as np

    from worlds.factory.layout import build_floor
    from worlds.factory.places import named_places

    floor = build_floor(spec.room(), np.random.default_rng(spec.seed))
    return tuple(Place(name, polygon) for name, polygon in named_places(floor))
