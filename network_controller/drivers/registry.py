"""Drivers by name."""

from __future__ import annotations

from network_controller.drivers.base import Driver
from swarm.errors import SettingError

DRIVERS = ("netns", "docker")


def make_driver(name: str, swarm: str) -> Driver:
    """The driver of that name for a swarm. Raises SettingError for an unknown name."""
    if name == "netns":
        from network_controller.drivers.netns import NetnsDriver

        return NetnsDriver(swarm)
    if name == "docker":
        from network_controller.drivers.docker import DockerDriver

        return DockerDriver(swarm)
    raise SettingError(f"COADAPT_DRIVER = {name!r} is not valid; allowed: {', '.join(DRIVERS)}")
