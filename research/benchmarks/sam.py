"""Scene Abstraction Module: time and recall of `fast` and `reference` on the OPV2V sample.

Both methods get the same points and are timed through `describe`, one right after the other, frame
by frame, on one core, without file reading. Writes build/bench/sam.json.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import numpy as np

from perception.scene import describe
from research.benchmarks.report import write_report
from research.benchmarks.scene_recall import match, targets
from swarm.errors import WorldError
from swarm.geometry import Points
from worlds.base import Scan, World
from worlds.sample import opv2v_sample

METHODS = ("fast", "reference")
SPARSE = 30
"""Vehicles with fewer visible points are reported on their own: the hard ones."""


def main() -> int:
    """Measures, prints the figures and writes them."""
    # One thread for OpenMP (Open3D reads it when first imported) and one core for all the rest.
    os.environ["OMP_NUM_THREADS"] = "1"
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    from worlds.opv2v.world import Opv2vWorld

    try:
        world = Opv2vWorld(opv2v_sample())
    except WorldError as error:
        print(f"sam: left out: {error}", file=sys.stderr)
        return 0
    scans = [world.scan(r, frame) for r in world.robots for frame in range(world.frame_count)]
    figures, samples = _recall(world, scans)
    times, objects = _times([scan.points for scan in scans])
    fast, reference = (np.array(times[method]) for method in METHODS)
    figures = {
        "speedup": float(np.median(reference) / np.median(fast)),
        "speedup_worst_frame": float((reference / fast).min()),
        **{f"{method}_ms_p50": float(np.median(times[method])) for method in METHODS},
        **{f"{method}_ms_p95": float(np.percentile(times[method], 95)) for method in METHODS},
        **figures,
        **{f"objects_{method}_p50": float(np.median(objects[method])) for method in METHODS},
        "frames": len(scans),
        "rounds": 1,
    }
    path = write_report("sam", figures, {**samples, "ms": times})
    print(json.dumps(figures, indent=1))
    print(f"wrote {path}")
    return 0


def _times(clouds: list[Points]) -> tuple[dict[str, list[float]], dict[str, list[int]]]:
    """Milliseconds of each method and how many objects it found, frame by frame."""
    times: dict[str, list[float]] = {method: [] for method in METHODS}
    objects: dict[str, list[int]] = {method: [] for method in METHODS}
    for method in METHODS:
        describe(clouds[0], method)  # imports and first allocations
    for cloud in clouds:
        for method in METHODS:
            started = time.perf_counter()
            scene = describe(cloud, method)
            times[method].append((time.perf_counter() - started) * 1e3)
            objects[method].append(len(scene.objects))
    return times, objects


def _recall(world: World, scans: list[Scan]) -> tuple[dict[str, Any], dict[str, Any]]:
    figures: dict[str, Any] = {}
    wanted = [list(targets(world, scan)) for scan in scans]
    visible = np.array([len(target.visible) for each in wanted for target in each])
    figures["vehicles"] = len(visible)
    figures[f"vehicles_under_{SPARSE}_points"] = int((visible < SPARSE).sum())
    for method in METHODS:
        found = [
            f
            for scan, each in zip(scans, wanted, strict=True)
            for f in match(scan.points, method, each)
        ]
        described = np.array([each.described for each in found])
        figures[f"recall_{method}"] = float(described.mean())
        figures[f"recall_{method}_under_{SPARSE}_points"] = float(
            described[visible < SPARSE].mean()
        )
        figures[f"strict_{method}"] = float(np.mean([each.strict for each in found]))
    return figures, {"visible_points": visible.tolist()}


if __name__ == "__main__":
    sys.exit(main())
