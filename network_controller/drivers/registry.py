"""Drivers by name: every module of this package that has `DRIVERS` adds them."""

from __future__ import annotations

from network_controller.drivers.base import Driver
from swarm.errors import SettingError
from swarm.registry import by_name, registered


def make_driver(name: str, swarm: str) -> Driver:
    """The driver of that name for a swarm. Raises SettingError for an unknown name."""
    found = by_name(registered("DRIVERS", "network_controller.drivers"), "drivers", SettingError)
    if name not in found:
        raise SettingError(f"COADAPT_DRIVER = {name!r} is not valid; allowed: {', '.join(found)}")
    driver: Driver = found[name](swarm)
    return driver
