"""`coadapt picture`: one fused frame from above, as PNG, SVG or PDF."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coadapt.arguments import add_algorithm, at_least_zero, comma_separated

if TYPE_CHECKING:
    from worlds.base import World

FRAME = 10
"""Where none is named: a swarm has moved by then."""


def register(commands: Any) -> None:
    """Adds `picture` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "picture",
        help="draw a fused frame from above",
        description="Draws one fused frame from above, in the ego's frame: points, true boxes "
        "(green) and boxes as an ego publishes them (red, with a line to the front).",
    )
    parser.add_argument(
        "world",
        metavar="WORLD",
        help="factory, road, opv2v, bag or recording; or recorded data itself: a recording of a "
        "swarm (.mcap), or a directory",
    )
    parser.add_argument("--data", type=Path, metavar="PATH", help="of recorded worlds: where")
    parser.add_argument(
        "--seed", type=int, default=1_000_000, help="factory, road: which (default: %(default)s)"
    )
    parser.add_argument("--robots", type=int, metavar="N", help="factory (6) and road (2)")
    parser.add_argument("--frame", type=int, metavar="F", help="number from 0 (default: 10)")
    parser.add_argument("--ego", help="the robot that fuses (default: the first)")
    parser.add_argument(
        "--participants",
        type=comma_separated,
        default=[],
        metavar="NAMES",
        help="robots that send, comma-separated (default: all)",
    )
    add_algorithm(parser)
    parser.add_argument("--pose-noise", type=at_least_zero, default=0.0, metavar="M")
    parser.add_argument("--delay", type=at_least_zero, default=0.0, metavar="S")
    parser.add_argument(
        "--only-found",
        action="store_true",
        help="show boxes found alone and together, and nothing of the recording itself",
    )
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help="the picture: .png, .svg or .pdf, in a directory that is there",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draws and writes. Raises CoAdaptError for bad data or names."""
    from options.pictures.saving import check_target, save
    from research.evaluation.picture import draw
    from worlds.cooperative.fusing import Disturbance

    check_target(args.output)
    world, ego, frame = _chosen(args)
    picture = draw(
        world,
        frame,
        args.ego or ego,
        args.participants or world.robots,
        args.algorithm,
        Disturbance(pose_noise_m=args.pose_noise, delay_s=args.delay),
        only_found=args.only_found,
    )
    save(picture, args.output)
    print(f"wrote {args.output}")
    return 0


def _chosen(args: argparse.Namespace) -> tuple[World, str, int]:
    """The world, its usual ego and the frame."""
    from coadapt.recorded import names_data, open_recorded
    from research.evaluation.splits import ROBOTS
    from worlds.registry import open_world

    if names_data(args.world):
        data = open_recorded(Path(args.world))
        data.tell_notes()
        usual = min(FRAME, len(data.frames) - 1)
        return data.world, data.ego, data.frame(str(usual if args.frame is None else args.frame))
    robots = args.robots or ROBOTS.get(args.world, 2)
    world = open_world(args.world, data=args.data, robots=robots, seed=args.seed)
    frame = FRAME if args.frame is None else args.frame
    return world, world.robots[0], frame % world.frame_count
