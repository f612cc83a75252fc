"""Arguments that several subcommands share."""

from __future__ import annotations

import argparse
import math
from pathlib import Path


def at_least_zero(text: str) -> float:
    """A finite number >= 0, or argparse's error."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number >= 0")
    return value


def add_recorded_fusion(parser: argparse.ArgumentParser) -> None:
    """Adds what is fused and how: DIR, --algorithm, --ego, --pose-noise and --json."""
    parser.add_argument("directory", type=Path, metavar="DIR", help="a recorded scenario")
    parser.add_argument("--algorithm", required=True, help="early or late; single is the ego alone")
    parser.add_argument("--ego", help="the robot that fuses (default: the first)")
    parser.add_argument(
        "--pose-noise",
        type=at_least_zero,
        default=0.0,
        metavar="M",
        help="standard deviation of the senders' poses, metres and degrees",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
