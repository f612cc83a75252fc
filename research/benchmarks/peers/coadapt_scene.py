"""The scene abstraction of the original CoAdapt, from a checkout that the reader fetches.

Its own functions run: ground by RANSAC, obstacles by DBSCAN, their description and its text, on a
cloud that Open3D has in memory. Beside it are our `fast`, and our `reference`, which is meant to be
the original's method: how far it is, is told. One core and one thread, in turn.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from perception.scene import describe
from research.benchmarks.intervals import ratio_of_medians
from research.benchmarks.peers.frames import Shared
from swarm.geometry import Points

VARIABLE = "COADAPT_ORIGINAL"
FILE = Path("lidar_processing/interpret_pointcloud.py")


def why_not() -> str | None:
    """Why the original cannot be measured here, or None."""
    checkout = os.environ.get(VARIABLE)
    if not checkout:
        return f"set {VARIABLE} to a checkout of github.com/houssamhh/coadapt"
    if not (Path(checkout) / FILE).is_file():
        return f"{VARIABLE}={checkout} has no {FILE}"
    return None


def measure(shared: Shared) -> tuple[dict[str, Any], dict[str, Any]]:
    """`ratio_coadapt_scene`: our `fast` over the original; samples. Needs `why_not` to be None."""
    import open3d as o3d

    original = _load(Path(os.environ[VARIABLE]) / FILE)
    clouds = [scan.points for scans in shared.scans for scan in scans]
    times: dict[str, list[float]] = {name: [] for name in ("fast", "reference", "original")}
    found: dict[str, list[int]] = {name: [] for name in times}
    for number, cloud in enumerate([clouds[0], *clouds]):
        known = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.astype(np.float64)))
        ways: dict[str, Callable[[], int]] = {
            "fast": partial(_ours, cloud, "fast"),
            "reference": partial(_ours, cloud, "reference"),
            "original": partial(_theirs, original, known),
        }
        for name, way in ways.items():
            o3d.utility.random.seed(0)
            begun = time.perf_counter()
            objects = way()
            if number:  # The first one is for imports and first allocations.
                times[name].append(round((time.perf_counter() - begun) * 1e3, 3))
                found[name].append(objects)
    ratio, interval = ratio_of_medians(times["fast"], times["original"])
    same, same_interval = ratio_of_medians(times["reference"], times["original"])
    figures = {
        "ratio_coadapt_scene": ratio,
        "coadapt_scene": {
            "ratio_interval": interval,
            "ratio_reference": same,
            "ratio_reference_interval": same_interval,
            "frames_with_equal_objects_of_reference": sum(
                a == b for a, b in zip(found["reference"], found["original"], strict=True)
            ),
            **{f"{name}_ms_p50": round(float(np.median(ms)), 2) for name, ms in times.items()},
            **{f"objects_{name}_p50": float(np.median(n)) for name, n in found.items()},
            "n": len(clouds),
        },
    }
    return figures, {"ms": times, "objects": found}


def _ours(points: Points, method: str) -> int:
    return len(describe(points, method).objects)


def _theirs(original: ModuleType, cloud: Any) -> int:
    _, objects = original.segment_ground(cloud)
    described = original.describe_obstacles(original.cluster_obstacles(objects))
    original.obstacles_to_text(described)
    return len(described)


def _load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("coadapt_original", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
