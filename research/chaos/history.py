"""What a run was to do, what it did, and what was seen meanwhile: all that is judged.

Times are seconds since the run's begin on the machine's steady clock.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

LET_IN = "a stranger was let in"
"""So begins what was seen of a fault in which somebody without a certificate had a session."""


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """One fault as a schedule has it."""

    kind: str
    target: str = ""
    """A robot's id where the kind hits one robot; else empty."""
    at_s: float
    lasts_s: float
    seed: int


class Played(msgspec.Struct, frozen=True, kw_only=True):
    """A fault as it was played."""

    fault: Fault
    begun_s: float
    ended_s: float
    up_s: float | None
    """When what was hit was heard again; None: it never was."""
    hits: tuple[str, ...]
    """Robots that it may keep from taking part."""
    ego_down: bool = False
    """The ego itself did not run meanwhile."""
    seen: str = ""
    error: str = ""
    """Why it could not be begun or ended."""


class Cycle(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the ego's journal."""

    at_s: float
    cycle: int
    started_ns: int
    valid: bool
    cycle_ms: float
    cost_bps: float
    capacity_bps: float
    participants: tuple[str, ...]
    out: Mapping[str, str]
    """Robots that were excluded, or chosen and silent, and why."""


class DecisionArrival(msgspec.Struct, frozen=True, kw_only=True):
    """A decision as somebody in the swarm heard it."""

    at_s: float
    cycle: int
    decided_ns: int


class Frame(msgspec.Struct, frozen=True, kw_only=True):
    """A fused frame as somebody in the swarm heard it."""

    at_s: float
    frame: int
    participants: tuple[str, ...]
    sizes: Mapping[str, int]
    """Bytes of the payloads that came in time, by robot."""
    missing: Mapping[str, str] = {}
    """Kinds of the reasons why robots are not in it (docs/journal.md)."""
    age_ms: float
    """As the ego tells it."""
    late_ms: float
    """How much older it was when it was heard, by this machine's clock; NaN where the ego's clock
    was another one."""
    known_s: float
    """The greatest age of a robot that is shown beside it."""


class Memory(msgspec.Struct, frozen=True, kw_only=True):
    """What a process held in memory."""

    at_s: float
    service: str
    pid: int
    rss_bytes: int


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """How well the swarm saw, beside how well its ego alone would have seen in the same frames."""

    frames: int
    """Spread over the run."""
    ap_70: float
    ap_70_alone: float


class History(msgspec.Struct, frozen=True, kw_only=True):
    """A whole run."""

    seconds: float
    period_s: float
    robots: tuple[str, ...]
    """All but the ego."""
    played: tuple[Played, ...] = ()
    cycles: tuple[Cycle, ...] = ()
    decisions: tuple[DecisionArrival, ...] = ()
    frames: tuple[Frame, ...] = ()
    memory: tuple[Memory, ...] = ()
    seen: Seen | None = None
    foreign_bytes: int = 0
    """Size of the payloads that strangers send in a robot's name."""
