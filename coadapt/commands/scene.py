"""`coadapt scene FILE`: the objects in one scan."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any


def register(commands: Any) -> None:
    """Adds `scene` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "scene",
        help="describe the objects in a scan",
        description="Describe the objects in a scan, in the sensor's frame as stored in the file.",
    )
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="a scan: .pcd, .ply, .npy, or .bin (KITTI)"
    )
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
    from worlds.scans import read_scan

    points = read_scan(args.file)
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
