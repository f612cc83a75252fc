"""Rates as people write them: 55mbit, 5.5mbit, 800kbit."""

from __future__ import annotations

import re

from swarm.errors import DeployError

_UNITS = {"bit": 1, "kbit": 1_000, "mbit": 1_000_000, "gbit": 1_000_000_000}
_RATE = re.compile(r"(?P<number>\d+(?:\.\d+)?)(?P<unit>[kmg]?bit)")


def parse_rate(text: str) -> int:
    """Bit/s of a rate such as `55mbit`. Raises DeployError when it is not one."""
    match = _RATE.fullmatch(text.strip().lower())
    if match is None:
        raise DeployError(f"rate {text!r} is not valid; write it like 55mbit, 5.5mbit or 800kbit")
    return round(float(match["number"]) * _UNITS[match["unit"]])


def format_rate(bps: float) -> str:
    """A rate for people: `55.0 Mbit/s`."""
    for unit, scale in (("Gbit/s", 1e9), ("Mbit/s", 1e6), ("kbit/s", 1e3)):
        if bps >= scale:
            return f"{bps / scale:.1f} {unit}"
    return f"{bps:.0f} bit/s"
