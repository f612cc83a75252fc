"""The world of a process's settings, a live robot among them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ros2.address import FORM, parse
from ros2.world import LiveWorld
from swarm.errors import SettingError
from swarm.log import make_logger
from swarm.process import ProcessSettings
from swarm.settings import PREFIX
from worlds.base import World
from worlds.registry import open_world


@contextmanager
def open_world_of(settings: ProcessSettings, process: str, robot: str) -> Iterator[World]:
    """The world that a process reads a robot's sensor in, closed at the end.

    Raises SettingError for a live robot's address that is missing or wrong, WorldError for data
    that cannot be used.
    """
    if settings.world == "ros2":
        with _live(settings, process, robot) as world:
            yield world
        return
    yield open_world(
        settings.world,
        data=Path(settings.world_data) if settings.world_data else None,
        robots=settings.world_robots,
        seed=settings.world_seed,
        rings=settings.world_rings,
        scenario=settings.world_scenario,
        cache=Path(settings.world_cache) if settings.world_cache else None,
    )


def _live(settings: ProcessSettings, process: str, robot: str) -> LiveWorld:
    if not settings.world_data:
        raise SettingError(f"world 'ros2' needs {PREFIX}WORLD_DATA, the robot's address: {FORM}")
    log = make_logger(process, level=settings.log_level, swarm=settings.swarm)
    return LiveWorld(parse(settings.world_data), robot, process, log)
