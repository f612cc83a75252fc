"""Size, error and time of the point codec on the OPV2V sample and on the factory floor.

Every frame is encoded and decoded whole and without its ground, at 10 cm and at 1 cm. Errors are
those of each original point to the decoded point in the same direction, over all frames. Times
are of whole clouds at both bounds, on one core. Writes build/bench/codec.json.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from perception.codec import generic
from perception.codec.points import decode_points, encode_points
from perception.scene import ground_mask
from research.benchmarks.report import write_report
from swarm.errors import WorldError
from swarm.geometry import Points
from worlds.factory.world import FactoryWorld
from worlds.opv2v.world import Opv2vWorld
from worlds.sample import opv2v_sample

BOUNDS_M = {"10cm": 0.1, "1cm": 0.01}
ROUNDS = 5
FACTORY_FRAMES = (0, 40, 80)


def main() -> int:
    """Measures, prints the figures and writes them."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    try:
        world = Opv2vWorld(opv2v_sample())
    except WorldError as error:
        print(f"codec: left out: {error}", file=sys.stderr)
        return 0
    real = [
        world.scan(robot, frame).points
        for robot in world.robots
        for frame in range(world.frame_count)
    ]
    sizes: dict[str, list[int]] = {}
    errors: dict[str, list[float]] = {}
    for name, bound in BOUNDS_M.items():
        for part, clouds in (("full", real), ("objects", [c[~ground_mask(c)] for c in real])):
            payloads = [encode_points(cloud, bound) for cloud in clouds]
            sizes[f"bytes_{part}_{name}"] = [len(payload) for payload in payloads]
            sizes[f"bytes_generic_{part}_{name}"] = [len(generic.encode(c, bound)) for c in clouds]
            errors.setdefault(f"max_error_m_{name}", []).extend(
                worst_error(cloud, decode_points(payload))
                for cloud, payload in zip(clouds, payloads, strict=True)
            )
    times = _times(real)
    factory = _factory()
    figures: dict[str, Any] = {
        **{name: float(np.median(values)) for name, values in sizes.items()},
        **{name: float(np.max(values)) for name, values in errors.items()},
        **{f"{name}_ms_p50": float(np.median(values)) for name, values in times.items()},
        **{f"{name}_ms_p95": float(np.percentile(values, 95)) for name, values in times.items()},
        "points_full": float(np.median([len(cloud) for cloud in real])),
        "frames": len(real),
        "rounds": ROUNDS,
        "factory": factory,
    }
    path = write_report("codec", figures, {**sizes, **errors, "ms": times})
    print(json.dumps(figures, indent=1))
    print(f"wrote {path}")
    return 0


def worst_error(original: Points, decoded: Points) -> float:
    """The largest distance in metres between points (N, 3) that share a direction.

    Rays lie far further apart than decoded directions are off, so the nearest direction is the
    same point. Infinite when the numbers of points differ.
    """
    if len(original) != len(decoded):
        return float("inf")
    one, other = (np.asarray(cloud, dtype=np.float64) for cloud in (original, decoded))
    directions = [c / np.linalg.norm(c, axis=1, keepdims=True) for c in (one, other)]
    nearest = cKDTree(directions[1]).query(directions[0])[1]
    return float(np.linalg.norm(one - other[nearest], axis=1).max(initial=0.0))


def _times(clouds: list[Points]) -> dict[str, list[float]]:
    """Milliseconds to encode and decode, over rounds, bounds and frames."""
    times: dict[str, list[float]] = {"encode": [], "decode": []}
    decode_points(encode_points(clouds[0]))  # imports and first allocations
    for _ in range(ROUNDS):
        for bound in BOUNDS_M.values():
            for cloud in clouds:
                start = time.perf_counter()
                payload = encode_points(cloud, bound)
                middle = time.perf_counter()
                decode_points(payload)
                times["encode"].append((middle - start) * 1e3)
                times["decode"].append((time.perf_counter() - middle) * 1e3)
    return times


def _factory() -> list[dict[str, float]]:
    """Median bytes of simulated scans by number of rings."""
    rows = []
    for rings in (16, 32, 64):
        world = FactoryWorld(robots=3, rings=rings)
        clouds = [
            world.scan(robot, frame).points for robot in world.robots for frame in FACTORY_FRAMES
        ]
        row = {"rings": rings, "points": float(np.median([len(cloud) for cloud in clouds]))}
        for name, bound in BOUNDS_M.items():
            payloads = [len(encode_points(cloud, bound)) for cloud in clouds]
            row[f"bytes_full_{name}"] = float(np.median(payloads))
        rows.append(row)
    return rows


if __name__ == "__main__":
    sys.exit(main())
