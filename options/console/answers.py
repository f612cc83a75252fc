"""What the console answers on its own account: the floor, history, recordings, errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from swarm.messages import Place


class Places(msgspec.Struct, frozen=True, kw_only=True):
    """The site's places, as pages are told of them."""

    places: tuple[Place, ...]
    words: Mapping[str, tuple[str, ...]] = {}
    """What people call a place besides, by its name."""
    drawable: bool = False
    """Whether there is a file to write them into."""
    trouble: str = ""
    """Why the file cannot be read."""


class Floor(Places, frozen=True, kw_only=True):
    """What stands still, metres in the world frame, and the places."""

    width_m: float | None
    """None where no plan is known."""
    depth_m: float | None
    rects: tuple[tuple[float, float, float, float], ...]
    """Footprints: low x, low y, high x, high y."""


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """One step of the past; None where there was nothing."""

    at: float
    """Seconds since the epoch."""
    capacity_bps: float | None
    robots: float | None
    """The ego included."""
    used_bps: float | None
    latency_ms: float | None
    algorithm: str | None
    source: str | None


class History(msgspec.Struct, frozen=True, kw_only=True):
    """What was decided and used, as Prometheus remembers it."""

    rows: tuple[Step, ...]


class Recorded(msgspec.Struct, frozen=True, kw_only=True):
    """A recording."""

    name: str
    bytes: int
    at: float
    """When it was last changed, seconds since the epoch."""


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """What has changed; the first event of a stream has everything."""

    now: float
    """The console's clock, seconds since the epoch."""
    full: bool = False
    """Forget what was known."""
    csrf: str = ""
    """Of the first event: what controls must show."""
    state: dict[str, Any]
    """By name; null: there is none any more."""
    history: tuple[dict[str, Any], ...]
    faults: tuple[dict[str, Any], ...]


class Error(msgspec.Struct, frozen=True):
    """The body of every refusal."""

    error: str
