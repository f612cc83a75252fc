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
    """Guaranteed."""
    classes: Mapping[TrafficClass, ClassShape]
    delay_ms: float = 0.0
    loss: float = 0.0
    cell_bps: int = 0
    """What the medium carries of which the link is a part, and lends from; 0: it is its own."""

    @property
    def ceil_bps(self) -> int:
        """What the link may have at most, with what others leave."""
        return max((one.ceil_bps for one in self.classes.values()), default=self.capacity_bps)


@dataclass(frozen=True, slots=True)
class Queue:
    """Where the kernel queues a link."""

    device: str
    """The interface of this network namespace that has the HTB."""
    slot: int = 0
    """Which of the links that share the HTB it is, from 1; 0: the HTB is its own."""


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
    cell_bps: int = 0
    """See `LinkShape`."""
    queue: Queue = Queue("")


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What this kernel can do for links."""

    present: frozenset[str]
    """Of FEATURES."""
    missing: Mapping[str, str]
    """Feature to the kernel's words; everything else of FEATURES."""


FEATURES = ("htb", "bfifo", "u32", "clsact", "mirred", "ifb", "netem", "fq_codel")
NEEDED = ("htb", "bfifo", "u32")
"""For shaping towards robots."""
NEEDED_UP = ("clsact", "mirred", "ifb")
"""For shaping from robots, and for one tree of all links of a cell, beside the others."""


def lacking(found: Capabilities) -> tuple[str, ...]:
    """What cannot be shaped with these capabilities, and why; nothing where all can."""
    for what, needed in (("links", NEEDED), ("links from robots", NEEDED_UP)):
        if missing := _missing(found, needed):
            return (f"{what} cannot be shaped: this kernel lacks {missing}",)
    return ()


def lacking_tree(found: Capabilities) -> str:
    """What keeps all links of a cell from one tree with these capabilities; empty for nothing."""
    return _missing(found, (*NEEDED, *NEEDED_UP))


def _missing(found: Capabilities, needed: tuple[str, ...]) -> str:
    return ", ".join(f"{one} ({found.missing[one]})" for one in needed if one in found.missing)
