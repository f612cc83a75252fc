"""`coadapt picture`: one fused frame from above, as SVG."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from coadapt.arguments import at_least_zero, comma_separated
from perception.fusion.algorithms import all_fusions


def register(commands: Any) -> None:
    """Adds `picture` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "picture",
        help="draw a fused frame from above",
        description="Draws one fused frame from above, in the ego's frame: points, true boxes "
        "(green) and boxes found with a score of 0.3 at least (red, with a line to the front).",
    )
    parser.add_argument("world", metavar="WORLD", help="factory, road, opv2v, bag or recording")
    parser.add_argument("--data", type=Path, metavar="PATH", help="of recorded worlds: where")
    parser.add_argument(
        "--seed", type=int, default=1_000_000, help="factory, road: which (default: %(default)s)"
    )
    parser.add_argument("--robots", type=int, metavar="N", help="factory (6) and road (2)")
    parser.add_argument("--frame", type=int, default=10, metavar="F", help="index (default: 10)")
    parser.add_argument("--ego", help="the robot that fuses (default: the first)")
    parser.add_argument(
        "--participants",
        type=comma_separated,
        default=[],
        metavar="NAMES",
        help="robots that send, comma-separated (default: all)",
    )
    parser.add_argument(
        "--algorithm",
        default="early",
        metavar="NAME",
        help=f"{', '.join(all_fusions())}; single is the ego alone (default: early)",
    )
    parser.add_argument("--pose-noise", type=at_least_zero, default=0.0, metavar="M")
    parser.add_argument("--delay", type=at_least_zero, default=0.0, metavar="S")
    parser.add_argument(
        "--only-found",
        action="store_true",
        help="show boxes found alone and together, and nothing of the recording itself",
    )
    parser.add_argument("--output", type=Path, required=True, metavar="FILE", help="an SVG file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draws and writes. Raises CoAdaptError for bad data or names."""
    from research.evaluation.picture import draw
    from research.evaluation.splits import ROBOTS
    from worlds.cooperative.fusing import Disturbance
    from worlds.registry import open_world

    robots = args.robots or ROBOTS.get(args.world, 2)
    world = open_world(args.world, data=args.data, robots=robots, seed=args.seed)
    picture = draw(
        world,
        args.frame % world.frame_count,
        args.ego or world.robots[0],
        args.participants or world.robots,
        args.algorithm,
        Disturbance(pose_noise_m=args.pose_noise, delay_s=args.delay),
        only_found=args.only_found,
    )
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(picture)
    print(f"wrote {args.output}")
    return 0
