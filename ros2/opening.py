"""The live robot of a process's settings."""

from __future__ import annotations

from ros2.address import FORM, parse
from ros2.world import LiveWorld
from swarm.errors import SettingError
from swarm.log import make_logger
from swarm.process import ProcessSettings
from swarm.settings import PREFIX


def open_live(settings: ProcessSettings, process: str, robot: str) -> LiveWorld:
    """The robot whose address `world_data` is, for a process that reads its sensor.

    Raises SettingError that names what is wrong with the address.
    """
    if not settings.world_data:
        raise SettingError(f"world 'ros2' needs {PREFIX}WORLD_DATA, the robot's address: {FORM}")
    log = make_logger(process, level=settings.log_level, swarm=settings.swarm)
    return LiveWorld(parse(settings.world_data), robot, log)
