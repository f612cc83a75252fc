"""Draco (PyPI's `DracoPy`) for points: bytes and time at the same worst error as our codec's.

Our codec holds each coordinate's error such that no point is further off than its bound, and Draco
is given the grid for which the same is true: its cells' diagonal is twice the worst error that ours
made in that frame. Draco does not keep the order of points, so its own worst error is taken to the
nearest point, which is never more than the true one. Whole clouds, one core, in turn.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from perception.codec.points import decode_points, encode_points
from research.benchmarks.codec import worst_error
from research.benchmarks.intervals import ratio_of_medians
from research.benchmarks.peers.frames import Shared
from swarm.geometry import Points

BOUNDS_M = {"10cm": 0.1, "1cm": 0.01}
LEVEL = 7
"""Of compression, 0 to 10: what Draco's own encoder takes by default."""
MOST_BITS = 30


def measure(shared: Shared) -> tuple[dict[str, Any], dict[str, Any]]:
    """`ratio_draco_*`: ours over Draco's; samples. Raises ImportError where it is not installed."""
    clouds = [scan.points for scans in shared.scans for scan in scans]
    figures: dict[str, Any] = {}
    samples: dict[str, Any] = {}
    rows = []
    for name, bound in BOUNDS_M.items():
        ours, theirs = [], []
        draco_points(ours_points(clouds[0], bound)[0], bound)  # imports and first allocations
        for cloud in clouds:
            decoded, mine = ours_points(cloud, bound)
            mine["error_m"] = worst_error(cloud, decoded)
            ours.append(mine)
            theirs.append(draco_points(cloud, mine["error_m"]))
        row: dict[str, Any] = {"bound_m": bound, "n": len(clouds)}
        for what in ("bytes", "encode_ms", "decode_ms"):
            pair = [[one[what] for one in side] for side in (ours, theirs)]
            ratio, interval = ratio_of_medians(*pair)
            figures[f"ratio_draco_{what}_{name}"] = ratio
            row |= {f"ratio_{what}": ratio, f"ratio_{what}_interval": interval}
            row |= {f"ours_{what}_p50": _p50(pair[0]), f"draco_{what}_p50": _p50(pair[1])}
        row["ours_error_m_max"] = max(one["error_m"] for one in ours)
        row["draco_error_m_max"] = max(one["error_m"] for one in theirs)
        rows.append(row)
        samples[name] = {"ours": ours, "draco": theirs}
    figures["draco"] = {"rows": rows, "level": LEVEL}
    return figures, samples


def ours_points(cloud: Points, bound: float) -> tuple[Points, dict[str, float]]:
    """Decoded points, and what it took."""
    begun = time.perf_counter()
    payload = encode_points(cloud, bound)
    encoded = time.perf_counter()
    decoded = decode_points(payload)
    return decoded, _took(begun, encoded, len(payload))


def draco_points(cloud: Points, error_m: float) -> dict[str, float]:
    """What Draco takes for a cloud with no point further off than `error_m`."""
    import DracoPy

    step = 2.0 * error_m / math.sqrt(3.0)
    low = cloud.min(axis=0)
    extent = float((cloud.max(axis=0) - low).max())
    bits = min(MOST_BITS, math.ceil(math.log2(extent / step + 1.0)))
    begun = time.perf_counter()
    payload = DracoPy.encode(
        cloud,
        quantization_bits=bits,
        quantization_range=(2**bits - 1) * step,
        quantization_origin=low.astype(np.float64),
        compression_level=LEVEL,
    )
    encoded = time.perf_counter()
    decoded = DracoPy.decode(payload).points
    took = _took(begun, encoded, len(payload))
    off = cKDTree(decoded).query(cloud)[0]
    return took | {"error_m": float(off.max())}


def _took(begun: float, encoded: float, size: int) -> dict[str, float]:
    decoded = time.perf_counter()
    return {
        "bytes": size,
        "encode_ms": round((encoded - begun) * 1e3, 3),
        "decode_ms": round((decoded - encoded) * 1e3, 3),
    }


def _p50(values: list[float]) -> float:
    return round(float(np.median(values)), 3)
