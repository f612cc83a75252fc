"""Argument types that several subcommands share."""

from __future__ import annotations

import argparse
import math


def at_least_zero(text: str) -> float:
    """A finite number >= 0, or argparse's error."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number >= 0")
    return value
