"""What a swarm's site calls its places and classes."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import msgspec

from deploy.paths import site_path
from deploy.spec import SwarmSpec
from swarm.messages import Place
from swarm.site_file import SiteFile, read_site, write_site

ASIDE = "site-before.json"
"""What was drawn on another floor."""


def site_file_of(spec: SwarmSpec) -> Path:
    """Where a swarm keeps the names of its places."""
    return Path(site_path(spec.var_dir))


def bring_site(spec: SwarmSpec) -> Path | None:
    """Writes the site file of a world that knows its own layout, unless the swarm has one of that
    floor, or one that somebody else wrote.

    Where places were drawn on another floor, that file is set aside; gives its new path. Raises
    OSError, and SettingError for a site file that is none.
    """
    places = _known_places(spec)
    if not places:
        return None
    path, aside = site_file_of(spec), None
    brought = _mark(places)
    if path.exists():
        found = read_site(path)
        if found.brought in ("", brought):
            return None
        if found.words or _mark(found.places) != found.brought:
            aside = path.with_name(ASIDE)
            path.replace(aside)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_site(path, SiteFile(places, brought=brought))
    return aside


def site_of(path: Path | None, spec: SwarmSpec) -> SiteFile:
    """A site file; by default the swarm's own, where it has none what its world knows. Raises
    SettingError."""
    if path is not None:
        return read_site(path)
    # What lies here of a swarm that this machine did not start is another swarm's.
    own = site_file_of(spec)
    if spec.run_dir and own.exists():
        return read_site(own)
    return SiteFile(_known_places(spec))


def classes_of(spec: SwarmSpec) -> tuple[str, ...]:
    """What the detector of a swarm's world tells apart, robots aside: they are known."""
    from perception.detector.grid import bev_config
    from swarm.errors import PerceptionError

    try:
        labels = bev_config(spec.world).labels
    except PerceptionError:
        return ()
    return tuple(label for label in labels if label != "robot")


def _mark(places: tuple[Place, ...]) -> str:
    """By which the same places are known again."""
    return sha256(msgspec.json.encode(places)).hexdigest()[:16]


def _known_places(spec: SwarmSpec) -> tuple[Place, ...]:
    if spec.world != "factory":
        return ()
    # Only here: most commands need no world.
    import numpy as np

    from worlds.factory.layout import build_floor
    from worlds.factory.places import named_places

    floor = build_floor(spec.room(), np.random.default_rng(spec.seed))
    return tuple(Place(name, polygon) for name, polygon in named_places(floor))
