"""Links and their shapes, as every driver and the control loop speak of them.

Rates are bit/s of IP packets with their Ethernet headers, as `tc` counts them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from swarm.messages import Direction
from swarm.traffic import TrafficClass

DIRECTIONS: tuple[Direction, ...] = ("down", "up")


@dataclass(frozen=True, slots=True, order=True)
class Link:
    """One direction of one robot's link. `down` goes to the robot, `up` comes from it; an ego's
    cell is its own link downwards."""

    robot: str
    direction: Direction

    def __str__(self) -> str:
        return f"{self.robot} {self.direction}"


@dataclass(frozen=True, slots=True)
class ClassShape:
    """What one traffic class may have of a link."""

    rate_bps: int
    """Guaranteed."""
    ceil_bps: int
    priority: int
    """0 is served first with what the guarantees leave."""


@dataclass(frozen=True, slots=True)
class LinkShape:
    """How one direction of a link is to be shaped."""

    capacity_bps: int
    classes: Mapping[TrafficClass, ClassShape]
    delay_ms: float = 0.0
    loss: float = 0.0


@dataclass(frozen=True, slots=True)
class ClassReading:
    """One class as the kernel has it: configuration, and counters since it was made."""

    shape: ClassShape
    sent_bytes: int
    backlog_bytes: int
    drops: int
    """Packets."""
    overlimits: int


@dataclass(frozen=True, slots=True)
class LinkReading:
    """A shaped link, read back from the kernel."""

    capacity_bps: int
    classes: Mapping[TrafficClass, ClassReading]
    delay_ms: float = 0.0
    loss: float = 0.0


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What this kernel can do for links."""

    present: frozenset[str]
    """Of FEATURES."""
    missing: Mapping[str, str]
    """Feature to the kernel's words; everything else of FEATURES."""


FEATURES = ("htb", "bfifo", "u32", "ingress", "mirred", "ifb", "netem", "fq_codel")
NEEDED = ("htb", "bfifo", "u32")
"""For shaping towards robots."""
NEEDED_UP = ("ingress", "mirred", "ifb")
"""For shaping from robots, beside the others."""


def lacking(found: Capabilities) -> tuple[str, ...]:
    """What cannot be shaped with these capabilities, and why; nothing where all can."""
    for what, needed in (("links", NEEDED), ("links from robots", NEEDED_UP)):
        missing = [
            f"{feature} ({found.missing[feature]})"
            for feature in needed
            if feature in found.missing
        ]
        if missing:
            return (f"{what} cannot be shaped: this kernel lacks {', '.join(missing)}",)
    return ()
