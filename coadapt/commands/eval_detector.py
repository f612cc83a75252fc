"""`coadapt eval-detector`: precision and bytes of every fusion algorithm."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from coadapt.arguments import at_least_one, comma_separated

REPORT = Path("build/eval/detector.json")


def register(commands: Any) -> None:
    """Adds `eval-detector` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "eval-detector",
        help="precision and bytes of the fusion algorithms",
        description="Measures every fusion algorithm on floors and streets that training never "
        "saw and on the OPV2V sample (`coadapt data`): clean, with noisy "
        "poses, with delay and with fewer robots. Writes one JSON file with a row for each.",
    )
    parser.add_argument(
        "--worlds",
        type=comma_separated,
        default=["factory", "road", "opv2v"],
        metavar="NAMES",
        help="comma-separated: factory, road, opv2v (default: all)",
    )
    parser.add_argument(
        "--algorithms", type=comma_separated, metavar="NAMES", help="comma-separated (default: all)"
    )
    parser.add_argument(
        "--frames",
        type=at_least_one,
        default=500,
        metavar="N",
        help="of each simulated world (default: 500)",
    )
    parser.add_argument(
        "--workers",
        type=at_least_one,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (default: one a core)",
    )
    parser.add_argument(
        "--output", type=Path, default=REPORT, metavar="FILE", help=f"default: {REPORT}"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measures and writes. Raises CoAdaptError for unknown names."""
    from research.evaluation.detector import run as measure

    measure(args.worlds, args.algorithms, args.frames, args.workers, args.output)
    return 0
