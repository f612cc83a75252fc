"""Rates, times and shares as people write them: 55mbit, 5.5mbit, 60s, 20ms, 1%."""

from __future__ import annotations

import re

from swarm.errors import DeployError
from swarm.messages import MAX_RATE_BPS, MIN_RATE_BPS

_NUMBER = r"(?P<number>[0-9]{1,15}(?:\.[0-9]{1,15})?)"
_UNITS = {"bit": 1, "kbit": 1_000, "mbit": 1_000_000, "gbit": 1_000_000_000, "tbit": 10**12}
_RATE = re.compile(_NUMBER + r"(?P<unit>[kmgt]?bit)")
_SECONDS = {"ms": 1e-3, "s": 1.0, "m": 60.0, "h": 3600.0}
_TIME = re.compile(_NUMBER + r"(?P<unit>ms|s|m|h)")
_SHARE = re.compile(_NUMBER + "%")


def parse_rate(text: str) -> int:
    """Bit/s of a rate. Raises DeployError when it is not one.

    >>> parse_rate("5.5mbit")
    5500000
    """
    match = _RATE.fullmatch(text.strip().lower())
    if match is None:
        raise DeployError(f"rate {text!r} is not valid; write it like 55mbit, 5.5mbit or 800kbit")
    return round(float(match["number"]) * _UNITS[match["unit"]])


def parse_link_rate(text: str) -> int:
    """Bit/s of a rate that a link may have. Raises DeployError for others."""
    limits = f"a link may have {MIN_RATE_BPS // 1000}kbit to {MAX_RATE_BPS // 10**9}gbit"
    try:
        rate_bps = parse_rate(text)
    except DeployError as error:
        raise DeployError(f"{error}; {limits}") from error
    if not MIN_RATE_BPS <= rate_bps <= MAX_RATE_BPS:
        raise DeployError(f"rate {text!r} is not possible; {limits}")
    return rate_bps


def parse_seconds(text: str, most_s: float) -> float:
    """Seconds of a time such as `60s`, `20ms`, `10m` or `1h`, at most `most_s`.

    Raises DeployError for others.
    """
    match = _TIME.fullmatch(text.strip().lower())
    seconds = float(match["number"]) * _SECONDS[match["unit"]] if match else 0.0
    if not 0.0 < seconds <= most_s:
        raise DeployError(
            f"time {text!r} is not valid; write it like 60s, 20ms, 10m or 1h, above 0 and up to "
            f"{most_s:g}s"
        )
    return seconds


def parse_share(text: str, most: float = 1.0) -> float:
    """A share such as `1%` as a number from 0 to `most`. Raises DeployError for others."""
    match = _SHARE.fullmatch(text.strip())
    if match is None or float(match["number"]) > 100.0 * most:
        raise DeployError(
            f"share {text!r} is not valid; write it like 1% or 0.5%, up to {100.0 * most:g}%"
        )
    return float(match["number"]) / 100.0


def format_rate(bps: float) -> str:
    """A rate for people: `55.0 Mbit/s`."""
    for unit, scale in (("Gbit/s", 1e9), ("Mbit/s", 1e6), ("kbit/s", 1e3)):
        if bps >= scale:
            return f"{bps / scale:.1f} {unit}"
    return f"{bps:.0f} bit/s"
