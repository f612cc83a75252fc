"""`coadapt ap DIR`: average precision of a fusion algorithm on a recorded scenario."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import Any

from coadapt.arguments import add_recorded_fusion, chosen_fusion, recorded_directory
from swarm.errors import WorldError


def register(commands: Any) -> None:
    """Adds `ap` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "ap",
        help="average precision on a recorded scenario",
        description="Average precision of a fusion algorithm over all frames of a directory in "
        "OPV2V's layout, all vehicles taking part. Boxes count within 140 m along and 40 m across "
        "the ego's heading (OPV2V's range), true ones with at least 5 points in all scans "
        "together; overlap is that of the footprints.",
    )
    add_recorded_fusion(parser)
    parser.add_argument(
        "--per-frame",
        action="store_true",
        help="rank detections within their frame only, as OpenCOOD's published tables do",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the figures. Raises CoAdaptError for bad data or names."""
    from options.bags.recording import holds_bags
    from worlds.cooperative.fusing import Disturbance
    from worlds.cooperative.judging import evaluate
    from worlds.opv2v.world import Opv2vWorld

    directory = recorded_directory(args)
    if holds_bags(directory):
        raise WorldError(
            f"{directory} holds robots' bags, which do not say what was really there: "
            "precision needs a recording with true boxes (OPV2V's layout)"
        )
    world = Opv2vWorld(directory)
    precision = evaluate(
        world,
        chosen_fusion(args),
        args.ego or world.robots[0],
        Disturbance(pose_noise_m=args.pose_noise, delay_s=args.delay),
        per_frame=args.per_frame,
    )
    figures = {name: round(value, 4) for name, value in asdict(precision).items()}
    if args.json:
        print(json.dumps(figures))
        return 0
    for name, value in figures.items():
        print(f"{name:22} {value}")
    return 0
