"""Settings of the robot process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import msgspec

from swarm.errors import SettingError
from swarm.messages import Algorithm
from swarm.process import ProcessSettings
from swarm.settings import PREFIX, Name, load


class RobotSettings(ProcessSettings, frozen=True, kw_only=True):
    """Which robots one process hosts, and how often they speak. Field `robots` is read from
    `COADAPT_ROBOTS`, comma-separated."""

    robots: Annotated[tuple[Name, ...], msgspec.Meta(min_length=1, max_length=1000)]
    clock_offset_s: Annotated[float, msgspec.Meta(ge=-3600, le=3600)] = 0.0
    """How far the robots' clock is ahead of this machine's, as a badly set clock would be."""
    beacon_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=100)] = 10.0
    scene_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=100)] = 2.0
    areas: bool = False
    """Say in the key in which cell of the floor a robot is, so that egos hear of their surroundings
    only: on a site of more than a few dozen robots."""
    algorithms: Annotated[tuple[Algorithm, ...], msgspec.Meta(max_length=16)] = ()
    """Fusion algorithms whose sizes beacons announce; empty: all that there are."""
    measure_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=100)] = 0.05
    """How often a robot encodes a frame for each of them that nobody asks for, only to know its
    size; one after the other."""
    ring_frames: Annotated[int, msgspec.Meta(ge=1, le=100)] = 10
    """Recent frames that a robot keeps to answer queries from."""
    world_learnt: bool = False
    """The world is the one that an ego told: where it tells of another one, the process ends, to be
    started anew."""
    workers: Annotated[int, msgspec.Meta(ge=1, le=64)] = 1
    """Threads that sense, and as many that describe; more than one pays with many robots."""


def load_settings(environment: Mapping[str, str] | None = None) -> RobotSettings:
    """The settings from the environment and the TOML file.

    Raises SettingError that names the variable, its value and what is allowed.
    """
    settings = load(RobotSettings, environment)
    if len(set(settings.robots)) != len(settings.robots):
        raise SettingError(
            f"{PREFIX}ROBOTS = {','.join(settings.robots)!r} names a robot twice; "
            "every id must be different"
        )
    return settings
