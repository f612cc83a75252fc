"""`coadapt fuse DATA`: one frame of recorded data, fused."""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

from coadapt.arguments import (
    add_recorded_fusion,
    chosen_fusion,
    comma_separated,
    recorded_data,
)
from perception.types import Boxes


def register(commands: Any) -> None:
    """Adds `fuse` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "fuse",
        help="fuse one frame of recorded data",
        description="Fuse one frame of a recording of a swarm, of a directory in OPV2V's layout, "
        "or of robots' bags or scans. Boxes are in the right-handed world frame (OPV2V: y is minus "
        "CARLA's y).",
    )
    add_recorded_fusion(parser)
    parser.add_argument("--frame", required=True, help="its number from 0, or its name (006220)")
    parser.add_argument(
        "--participants",
        type=comma_separated,
        default=[],
        metavar="NAMES",
        help="robots that send, comma-separated (default: all)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the fused boxes of one frame. Raises CoAdaptError for bad data or names."""
    from perception.fusion.known import bodies
    from worlds.cooperative.fusing import Disturbance, fuse_frame

    data = recorded_data(args)
    world, frame = data.world, data.frame(args.frame)
    ego = args.ego or data.ego
    participants = args.participants or world.robots
    fusion = chosen_fusion(args)
    disturbance = Disturbance(pose_noise_m=args.pose_noise, delay_s=args.delay)
    # Files and weights are read first: they are not part of the time.
    fuse_frame(world, frame, ego, participants, fusion, disturbance)
    started = time.perf_counter()
    fused = fuse_frame(world, frame, ego, participants, fusion, disturbance)
    elapsed_ms = (time.perf_counter() - started) * 1e3
    if args.json:
        rows = [_row(fused.boxes, i) for i in range(len(fused.boxes))]
        told = bodies(fused.known)
        known = [{"robot": one.robot, **_row(told, at)} for at, one in enumerate(fused.known)]
        figures = {
            "boxes": rows,
            "known": known,
            "bytes": fused.bytes,
            "elapsed_ms": round(elapsed_ms, 3),
        }
        print(json.dumps(figures))
        return 0
    print(
        "label       score  centre x, y, z (m)            length, width, height (m)  heading (rad)"
    )
    for i, label in enumerate(fused.boxes.labels):
        center = " ".join(f"{v:9.2f}" for v in fused.boxes.centers[i])
        size = " ".join(f"{v:7.2f}" for v in fused.boxes.sizes[i])
        heading, score = fused.boxes.headings[i], fused.boxes.scores[i]
        print(f"{label:10} {score:6.2f}  {center}  {size}    {heading:9.3f}")
    sent = ", ".join(f"{robot} {size}" for robot, size in fused.bytes.items()) or "nothing"
    names = ", ".join(one.robot for one in fused.known) or "none"
    print(f"{len(fused.boxes)} boxes; known robots: {names}; bytes: {sent}; {elapsed_ms:.1f} ms")
    return 0


def _row(boxes: Boxes, index: int) -> dict[str, Any]:
    return {
        "center": [round(float(v), 3) for v in boxes.centers[index]],
        "size": [round(float(v), 3) for v in boxes.sizes[index]],
        "heading": round(float(boxes.headings[index]), 4),
        "score": round(float(boxes.scores[index]), 4),
        "label": boxes.labels[index],
    }
