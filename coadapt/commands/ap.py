"""`coadapt ap DATA`: average precision of a fusion algorithm on recorded data."""

from __future__ import annotations

import argparse
import json
from typing import Any

from coadapt.arguments import add_recorded_fusion, chosen_fusion, recorded_data
from swarm.errors import SettingError


def register(commands: Any) -> None:
    """Adds `ap` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "ap",
        help="average precision on recorded data",
        description="Average precision of a fusion algorithm over all frames of a recording of a "
        "swarm, or of a directory in OPV2V's layout, which hold the truth (bags and plain scans do "
        "not), all robots taking part. Boxes count within "
        "140 m along and 40 m across the ego's heading on roads (OPV2V's range), within 25 m in a "
        "factory, true ones with at least 5 points in all scans together; overlap is that of the "
        "footprints.",
    )
    add_recorded_fusion(parser)
    parser.add_argument(
        "--per-frame",
        action="store_true",
        help="rank detections within their frame only, as OpenCOOD's published tables do",
    )
    parser.add_argument(
        "--tracks",
        action="store_true",
        help="judge what the ego tells from memory, frame after frame, in place of each frame by "
        "itself; the first second does not count",
    )
    parser.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="with --tracks: how often robots send (default: in every frame)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the figures. Raises CoAdaptError for bad data or names."""
    from perception.tally import CLASS_KEYS
    from worlds.cooperative.fusing import Disturbance
    from worlds.cooperative.judging import tallied

    if args.rate is not None and not args.tracks:
        raise SettingError("--rate needs --tracks: without memory every frame stands by itself")
    data = recorded_data(args)
    frames = data.judged()
    tally = tallied(
        data.world,
        chosen_fusion(args),
        args.ego or data.ego,
        Disturbance(pose_noise_m=args.pose_noise, delay_s=args.delay),
        frames,
        remembered=args.tracks,
        rate_hz=args.rate,
    )
    figures = tally.precision(per_frame=args.per_frame).figures()
    classes = {
        label: one.figures(*CLASS_KEYS)
        for label, one in tally.classes(per_frame=args.per_frame).items()
    }
    if args.json:
        print(json.dumps({**figures, "classes": classes}))
        return 0
    for name, value in figures.items():
        print(f"{name:22} {value}")
    for label, of_class in classes.items():
        print(f"{label:22} " + "  ".join(f"{name} {value}" for name, value in of_class.items()))
    return 0
