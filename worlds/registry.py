"""Worlds by name."""

from __future__ import annotations

from pathlib import Path

from swarm.errors import WorldError
from worlds.base import World

WORLDS = ("bag", "factory", "opv2v", "recording", "road")


def open_world(
    name: str,
    *,
    data: Path | None = None,
    robots: int = 6,
    seed: int = 1,
    rings: int = 32,
    scenario: str = "floor",
    cache: Path | None = None,
) -> World:
    """The world of that name.

    Args:
        name: one of WORLDS.
        data: directory of a recorded scenario, needed by `opv2v`, or of bags, needed by `bag`; the
            file of `coadapt record`, needed by `recording`.
        robots: number of simulated robots.
        seed: of everything random in a simulated world.
        rings: of the simulated LiDAR of `factory`; `road` has OPV2V's.
        scenario: of `factory`.
        cache: directory in which scans are kept between runs; None keeps none.

    Raises WorldError for an unknown name, missing data or a value that the world does not allow.
    """
    if name == "opv2v":
        from worlds.opv2v import Opv2vWorld

        if data is None:
            raise WorldError("world 'opv2v' needs the directory of a recorded scenario (DATA=...)")
        return Opv2vWorld(data, cache)
    if name == "bag":
        from worlds.bag.world import BagWorld

        if data is None:
            raise WorldError("world 'bag' needs the directory of the robots' bags (DATA=...)")
        return BagWorld(data)
    if name == "recording":
        from worlds.recording.world import RecordingWorld

        if data is None:
            raise WorldError("world 'recording' needs the file of a recording (DATA=FILE.mcap)")
        return RecordingWorld(data)
    if name == "factory":
        from worlds.factory import FactoryWorld

        return FactoryWorld(robots=robots, seed=seed, rings=rings, scenario=scenario, cache=cache)
    if name == "road":
        from worlds.road import RoadWorld

        return RoadWorld(robots=robots, seed=seed, cache=cache)
    raise WorldError(f"world {name!r} is not known; allowed: {', '.join(WORLDS)}")
