"""The world of a process's settings, a live robot among them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from swarm.errors import SettingError
from swarm.log import make_logger
from swarm.process import ProcessSettings
from swarm.settings import PREFIX
from worlds.base import World
from worlds.cooperative.pose_errors import Mislocalised
from worlds.kinds import Reader
from worlds.registry import open_world, world_kind, world_kinds
from worlds.remarks import Choosing, Noted


@contextmanager
def open_world_of(settings: ProcessSettings, process: str, robot: str) -> Iterator[World]:
    """The world that a process reads a robot's sensor in, closed at the end.

    Raises SettingError for an unknown world and a live robot's address that is missing or wrong,
    WorldError for data that cannot be used.
    """
    if settings.world not in world_kinds():
        raise SettingError(
            f"{PREFIX}WORLD = {settings.world!r}; allowed: {', '.join(world_kinds())}"
        )
    kind = world_kind(settings.world)
    if kind.data and not settings.world_data:
        raise SettingError(f"world {kind.name!r} needs {PREFIX}WORLD_DATA, {kind.needs}")
    if kind.data == "address" and settings.pose_error_m:
        raise SettingError(
            f"{PREFIX}POSE_ERROR_M = {settings.pose_error_m:g}: a live robot errs by itself; "
            f"allowed in world {kind.name!r}: 0"
        )
    log = make_logger(process, level=settings.log_level, swarm=settings.swarm)
    world = open_world(
        settings.world,
        data=settings.world_data,
        robots=settings.world_robots,
        seed=settings.world_seed,
        rings=settings.world_rings,
        scenario=settings.world_scenario,
        cache=Path(settings.world_cache) if settings.world_cache else None,
        reader=Reader(process, robot, log),
    )
    if isinstance(world, Noted):
        for note in world.notes:
            log.warning("world_note", note=note)
    if isinstance(world, Choosing):
        for choice in world.choices:
            log.info("world_choice", choice=choice)
    seen = world
    if settings.pose_error_m:
        seen = Mislocalised(world, settings.pose_error_m, settings.world_seed)
    if isinstance(world, AbstractContextManager):
        with world:
            yield seen
    else:
        yield seen
