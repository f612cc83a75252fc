"""How a link's capacity is divided between the traffic classes, level by level.

Level 0 is the normal state: fusion and background have equal guarantees and share what is left.
Each further level is one step towards fusion: first its priority rises, so that it takes all that
the guarantees leave; then guaranteed rate moves from background to fusion, down to background's
floor. Control's guarantee is never touched and it is always served first.
"""

from __future__ import annotations

from collections.abc import Mapping

from network_controller.model import ClassShape, LinkShape
from swarm.traffic import TrafficClass

CONTROL_SHARE = 0.10
_FUSION_BACKGROUND = ((0.25, 0.25), (0.25, 0.25), (0.35, 0.15), (0.45, 0.05))
"""Guaranteed shares of fusion and background at each level; the last is background's floor."""
TOP = len(_FUSION_BACKGROUND) - 1


def shape(
    capacity_bps: int,
    level: int,
    *,
    delay_ms: float = 0.0,
    loss: float = 0.0,
    ceil_bps: int = 0,
    cell_bps: int = 0,
) -> LinkShape:
    """The division of a capacity in bit/s at a level from 0 to TOP. Of a cell that carries
    `cell_bps` the link may have `ceil_bps` at most; without one its capacity is all that it has.

    Raises ValueError for another level.
    """
    if not 0 <= level <= TOP:
        raise ValueError(f"level {level} is not from 0 to {TOP}")
    fusion, background = _FUSION_BACKGROUND[level]
    shares = {
        TrafficClass.CONTROL: (CONTROL_SHARE, 0),
        TrafficClass.FUSION: (fusion, 1),
        TrafficClass.BACKGROUND: (background, 1 if level == 0 else 2),
    }
    ceil_bps = max(ceil_bps, capacity_bps)
    classes = {
        traffic: ClassShape(max(1, round(capacity_bps * share)), ceil_bps, priority)
        for traffic, (share, priority) in shares.items()
    }
    return LinkShape(capacity_bps, classes, delay_ms, loss, cell_bps)


def level_of(capacity_bps: int, classes: Mapping[TrafficClass, ClassShape]) -> int | None:
    """The level that a division of a capacity is at, also when its rates were rounded; None for
    none of them."""
    try:
        fusion, background = classes[TrafficClass.FUSION], classes[TrafficClass.BACKGROUND]
    except KeyError:
        return None
    for level in range(TOP + 1):
        wanted = shape(capacity_bps, level).classes
        if background.priority == wanted[TrafficClass.BACKGROUND].priority and all(
            abs(have.rate_bps - wanted[traffic].rate_bps) <= 0.02 * capacity_bps
            for traffic, have in (
                (TrafficClass.FUSION, fusion),
                (TrafficClass.BACKGROUND, background),
            )
        ):
            return level
    return None


def available_bps(capacity_bps: int, level: int, control_bps: float, background_bps: float) -> int:
    """What fusion can have at a level when control and background want that much, bit/s.

    At level 0 what the guarantees leave is shared in equal parts, above it fusion comes first.
    """
    division = shape(capacity_bps, level).classes
    fusion = division[TrafficClass.FUSION].rate_bps
    guaranteed = division[TrafficClass.BACKGROUND].rate_bps
    left = capacity_bps - min(capacity_bps, control_bps)
    if level == 0:
        background = min(background_bps, max(guaranteed, left / 2))
    else:
        background = min(background_bps, guaranteed)
    return round(min(capacity_bps, max(fusion, left - background)))
