"""`coadapt scene FILE`: the objects in one scan."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm.errors import ScanError

if TYPE_CHECKING:
    from swarm.geometry import Points


def register(commands: Any) -> None:
    """Adds `scene` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "scene",
        help="describe the objects in a scan",
        description="Describe the objects in a scan, in the sensor's frame as stored in the file.",
    )
    parser.add_argument(
        "file",
        type=Path,
        metavar="FILE",
        help="a scan: .pcd, .ply, .npy, or .bin (KITTI); or a recording of a swarm (.mcap)",
    )
    parser.add_argument("--robot", help="of a recording: whose scan (default: the ego's)")
    parser.add_argument("--frame", metavar="F", help="of a recording: number from 0 (default: 0)")
    parser.add_argument(
        "--method",
        choices=("fast", "reference"),
        default="fast",
        help="fast: grid and connected cells; reference: RANSAC and DBSCAN (default: fast)",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the description of one file. Raises CoAdaptError when it cannot be read."""
    from perception.scene import describe

    points = _points(args)
    describe(points[:5], method=args.method)  # loads the method's libraries: not part of the time
    started = time.perf_counter()
    scene = describe(points, method=args.method)
    elapsed_ms = (time.perf_counter() - started) * 1e3

    if args.json:
        report = {
            "objects": [
                {
                    "centroid": list(found.centroid),
                    "distance": found.distance,
                    "size": list(found.size),
                    "points": found.points,
                    "density": found.density,
                }
                for found in scene.objects
            ],
            "ground_points": scene.ground_points,
            "elapsed_ms": elapsed_ms,
        }
        print(json.dumps(report, allow_nan=False))
        return 0

    print(f"{'distance':>9}  {'centroid x, y, z (m)':^26}  {'size (m)':^20}  points  density")
    for found in sorted(scene.objects, key=lambda each: each.distance):
        centroid = " ".join(f"{value:8.2f}" for value in found.centroid)
        size = " ".join(f"{value:6.2f}" for value in found.size)
        print(f"{found.distance:9.2f}  {centroid}  {size}  {found.points:6d}  {found.density:7.1f}")
    print(
        f"{len(scene.objects)} objects, {scene.ground_points} ground points of {len(points)}, "
        f"{elapsed_ms:.1f} ms ({args.method})"
    )
    return 0


def _points(args: argparse.Namespace) -> Points:
    """The scan of a file, or of a robot in one frame of a recording."""
    from coadapt.recorded import open_recorded
    from worlds.scans import read_scan

    if args.file.suffix.lower() != ".mcap":
        if args.robot is not None or args.frame is not None:
            raise ScanError(f"{args.file} is one scan; --robot and --frame are of a recording")
        return read_scan(args.file)
    data = open_recorded(args.file)
    data.tell_notes()
    points = data.world.scan(args.robot or data.ego, data.frame(args.frame or "0")).points
    if not len(points):
        raise ScanError(
            f"{args.file} holds no scan of {args.robot or data.ego} in frame {args.frame or 0}"
        )
    return points
