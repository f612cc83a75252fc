"""`python -m research.benchmarks.peers [NAME...]`: others' programs beside ours, on the same input.

Every `ratio_*` is ours over theirs: below 1 is better, but for `ratio_*_throughput`. A peer that is
not at hand is skipped with a word (`<name>_missing`); docs/benchmarks.md says how to get each one.
OpenCOOD is measured with our detector (`detector.json`), LiteLLM with our gateway (`gateway.json`).
Writes build/bench/peers.json.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

from deploy.runtimes.netns import NetnsRuntime
from research.benchmarks.peers import coadapt_scene, draco, zenoh_get
from research.benchmarks.peers.frames import Shared, shared_frames
from research.benchmarks.report import write_report

Measured = tuple[dict[str, Any], dict[str, Any]]


def no_draco() -> str | None:
    """Why Draco cannot be measured here, or None."""
    missing = importlib.util.find_spec("DracoPy") is None
    return ".venv/bin/python -m pip install DracoPy" if missing else None


def on_one_core(measure: Callable[[Shared], Measured], shared: Shared) -> Measured:
    """What it measures on one core."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        return measure(shared)
    finally:
        os.sched_setaffinity(0, allowed)


PEERS: dict[str, tuple[Callable[[], str | None], Callable[[Shared], Measured]]] = {
    "draco": (no_draco, partial(on_one_core, draco.measure)),
    "coadapt_scene": (coadapt_scene.why_not, partial(on_one_core, coadapt_scene.measure)),
    "zenoh_get": (NetnsRuntime().available, lambda _: zenoh_get.measure()),
}
"""Why it cannot be measured, and measuring it."""


def main() -> int:
    """Measures the peers that are at hand and writes peers.json."""
    parser = argparse.ArgumentParser(
        prog="python -m research.benchmarks.peers", description=__doc__
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PEERS))
    names = parser.parse_args().names or list(PEERS)
    # Open3D reads it when it is first imported.
    os.environ["OMP_NUM_THREADS"] = "1"
    shared = shared_frames()
    figures: dict[str, Any] = {"frames": shared.name}
    samples: dict[str, Any] = {}
    for name in names:
        why_not, measure = PEERS[name]
        missing = why_not()
        figures[f"{name}_missing"] = missing
        if missing is not None:
            print(f"peers: {name} is left out: {missing}", file=sys.stderr)
            continue
        found, samples[name] = measure(shared)
        figures |= found
    ratios = {name: value for name, value in figures.items() if name.startswith("ratio_")}
    for name, value in ratios.items():
        print(f"peers: {name} {value}")
    write_report("peers", ratios | figures, samples)
    return 0


if __name__ == "__main__":
    sys.exit(main())
