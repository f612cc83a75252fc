"""The profiles that sessions can ask for, and what each one promises.

A profile is a level of the ladder, so what it promises is computed from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import get_args

from msgspec import UNSET, UnsetType

from network_controller import ladder
from network_controller.model import ClassShape
from network_controller.qod.messages import Duration, QosProfile, Rate, RateUnit
from swarm.traffic import TrafficClass

LEVELS: Mapping[str, int] = MappingProxyType(
    {"QOS_E": 1, "QOS_S": 1, "QOS_M": 2, "QOS_L": ladder.TOP}
)
MIN_DURATION_S = 1
MAX_DURATION_S = 24 * 3600
"""Of a session with all its extensions; a forgotten one must not disadvantage others for long."""
_WHOLE_BPS = 1_000_000
_UNITS: tuple[RateUnit, ...] = get_args(RateUnit)


def profile(name: str, capacity_bps: int | None = None) -> QosProfile:
    """A profile of LEVELS, with its rate where the capacity of the link is given, bit/s."""
    level = LEVELS[name]
    rate: Rate | UnsetType = UNSET
    if capacity_bps is not None:
        rate = rounded_down(ladder.shape(capacity_bps, level).classes[TrafficClass.FUSION].rate_bps)
    return QosProfile(
        name=name,
        description=_describe(level),
        status="ACTIVE",
        target_min_downstream_rate=rate,
        min_duration=Duration(value=MIN_DURATION_S),
        max_duration=Duration(value=MAX_DURATION_S),
    )


def rounded_down(rate_bps: int) -> Rate:
    """A rate in the smallest unit whose number the API can express: a promise is never too high."""
    value = rate_bps
    for unit in _UNITS[:-1]:
        if value <= 1024:
            return Rate(value=value, unit=unit)
        value //= 1000
    return Rate(value=min(value, 1024), unit=_UNITS[-1])


def _describe(level: int) -> str:
    classes = ladder.shape(_WHOLE_BPS, level).classes
    fusion, background = classes[TrafficClass.FUSION], classes[TrafficClass.BACKGROUND]
    return (
        "Towards the device, fusion traffic as a whole is served before background, with at least "
        f"{_share(fusion)} of the link's capacity; background keeps {_share(background)}. "
        "Delay follows from that, but no figure is promised."
    )


def _share(one: ClassShape) -> str:
    return f"{one.rate_bps / _WHOLE_BPS:.0%}"
