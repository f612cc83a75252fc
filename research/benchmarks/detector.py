"""Time and memory of the detectors and of every fusion algorithm.

Points to boxes on two threads; what a robot encodes on one core; what an ego does with the payloads
of 2 to 50 robots on two threads (more than six: those of the five nearest repeated, so that every
robot brings as much as a near one); memory of a process that encodes like a robot; points to boxes
beside the same in float32 in PyTorch, cloud by cloud in turn (`ratio_torch_*`); our time over
OpenCOOD's (`ratio_opencood_*`), where the reader has it (`peers/opencood.py`). Writes
build/bench/detector.json and build/bench/detector.svg.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure

from perception.detector.finders import Finder, Learned
from perception.detector.learned import Detector
from perception.detector.weight_files import has_weights
from perception.fusion.base import Contribution, EncodeOptions, Fusion
from perception.fusion.detectors import detector_backend, shared_finder
from perception.fusion.registry import fusion_names, make_fusion
from research.benchmarks.peers.opencood import ratios as opencood_ratios
from research.benchmarks.report import write_report
from research.evaluation.splits import Part, nearest_first
from research.training.plans import TEST_SEEDS
from swarm.memory import keep_freed_memory
from worlds.base import World

THREADS = 2
FRAMES = (10, 40, 70)
ROUNDS = 5
ROBOTS = (2, 6, 12, 25, 50)
MANY = 12
MANY_ROUNDS = 3
"""With so many robots a frame takes long, and its time varies little."""
MEMORY_FRAMES = 20
DETECTORS = ("factory", "road")


def main() -> None:
    """Measures, prints the figures and writes them."""
    worlds = {name: Part(name, TEST_SEEDS.start, None, 0, FRAMES).open() for name in DETECTORS}
    samples: dict[str, Any] = {}
    figures: dict[str, Any] = {
        "detector": {name: "learned" if has_weights(name) else "clustered" for name in DETECTORS}
    }
    torch.set_num_threads(THREADS)
    figures["backend"] = {name: detector_backend(name) for name in DETECTORS}
    for name, world in worlds.items():
        samples[f"{name}_ms"], samples[f"{name}_torch_ms"] = _detect(world)
        figures[f"{name}_ms_p50"] = _median(samples[f"{name}_ms"])
        figures[f"ratio_torch_{name}"] = round(
            float(np.median(samples[f"{name}_ms"]) / np.median(samples[f"{name}_torch_ms"])), 3
        )
    with one_core():
        samples["encode_ms"] = {name: _encode(world) for name, world in worlds.items()}
    figures["encode_ms_p50"] = {
        name: {algorithm: _median(times) for algorithm, times in by_algorithm.items()}
        for name, by_algorithm in samples["encode_ms"].items()
    }
    rows = [
        _fuse(worlds["factory"], make_fusion(name, "factory"), robots)
        for name in fusion_names("factory")
        for robots in ROBOTS
    ]
    figures["fuse_ms_p50"] = {
        name: {str(row["robots"]): row["fuse_ms_p50"] for row in rows if row["algorithm"] == name}
        for name in fusion_names("factory")
    }
    figures["linear"] = {
        name: _line(figures["fuse_ms_p50"][name]) for name in fusion_names("factory")
    }
    figures["memory_mb"] = {name: _memory_of_child(name) for name in DETECTORS}
    figures["rows"] = rows
    peer, samples["opencood"] = opencood_ratios()
    figures |= peer
    path = write_report("detector", figures, samples)
    chart = path.with_suffix(".svg")
    _draw(chart, figures["fuse_ms_p50"])
    print(json.dumps(figures, indent=1))
    print(f"wrote {path} and {chart}")


def _draw(path: Path, fuse_ms: dict[str, dict[str, float]]) -> None:
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for name, by_robots in fuse_ms.items():
        axes.plot([int(robots) for robots in by_robots], list(by_robots.values()), label=name)
    axes.set(xlabel="robots", ylabel="ms from payloads to boxes", xlim=(0, None), ylim=(0, None))
    axes.legend()
    figure.savefig(path)


@contextmanager
def one_core() -> Iterator[None]:
    """Runs on one core, with one thread of PyTorch's."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(THREADS)
        os.sched_setaffinity(0, allowed)


def _detect(world: World) -> tuple[list[float], list[float]]:
    """Points to boxes by what runs here, and in float32 in PyTorch."""
    finder, exact = shared_finder(world.detector), _exact_finder(world.detector)
    clouds = [world.scan(robot, frame).points for robot in world.robots for frame in FRAMES]
    for one in (finder, exact):
        one.find(clouds[0])  # imports and first allocations
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(ROUNDS):
        for cloud in clouds:
            for one, into in zip((finder, exact), times, strict=True):
                into.append(_ms(partial(one.find, cloud)))
    return times


def _exact_finder(name: str) -> Finder:
    if not has_weights(name):
        return shared_finder(name)
    finder = Learned(name)
    finder.detector = Detector(name, backend="torch")
    return finder


def _encode(world: World) -> dict[str, list[float]]:
    """What the ego's nearest robot does when asked."""
    times: dict[str, list[float]] = {}
    for name in fusion_names(world.detector):
        fusion = make_fusion(name, world.detector)
        jobs = []
        for frame in FRAMES:
            ego, sender = nearest_first(world, world.robots[0], frame)[:2]
            jobs.append((world.scan(sender, frame).points, _options(world, fusion, ego, sender)))
        fusion.encode(*jobs[0])
        times[name] = [_ms(partial(fusion.encode, *job)) for _ in range(ROUNDS) for job in jobs]
    return times


def _options(world: World, fusion: Fusion, ego: str, sender: str) -> EncodeOptions:
    own = world.scan(ego, FRAMES[0])
    ask = fusion.begin(own.points, own.pose.matrix()).ask()
    pose = world.pose(sender, FRAMES[0])
    return EncodeOptions(pose=pose, reference=ask.reference, demand=ask.demand)


def _fuse(world: World, fusion: Fusion, robots: int) -> dict[str, Any]:
    """The ego's work in two parts: before payloads arrive, and from the first payload to boxes."""
    frame = FRAMES[0]
    ego, *others = nearest_first(world, world.robots[0], frame)
    own = world.scan(ego, frame)
    ask = fusion.begin(own.points, own.pose.matrix()).ask()
    sent = []
    for robot in others:
        scan = world.scan(robot, frame)
        options = EncodeOptions(pose=scan.pose, reference=ask.reference, demand=ask.demand)
        sent.append(Contribution(robot, fusion.encode(scan.points, options), scan.pose.matrix()))
    contributions = list(islice(cycle(sent), robots - 1))
    before, after = [], []
    for _ in range(1 + (ROUNDS if robots < MANY else MANY_ROUNDS)):
        begun = time.perf_counter()
        gathering = fusion.begin(own.points, own.pose.matrix())
        gathering.ask()
        gathering.prepare()
        arrived = time.perf_counter()
        for contribution in contributions:
            gathering.add(contribution)
        gathering.finish()
        before.append((arrived - begun) * 1e3)
        after.append((time.perf_counter() - arrived) * 1e3)
    print(f"{fusion.name}, {robots} robots: {_median(after[1:])} ms", file=sys.stderr, flush=True)
    return {
        "algorithm": fusion.name,
        "robots": robots,
        "begin_ms_p50": _median(before[1:]),
        "fuse_ms_p50": _median(after[1:]),
        "bytes_per_robot": round(float(np.mean([len(c.payload) for c in contributions]))),
    }


def _line(by_robots: dict[str, float]) -> dict[str, float]:
    """Least squares of time over robots: milliseconds a robot, of the ego alone, and r2."""
    x = np.array([float(robots) for robots in by_robots])
    y = np.array(list(by_robots.values()))
    slope, fixed = np.polyfit(x, y, 1)
    left = y - (slope * x + fixed)
    return {
        "ms_per_robot": round(float(slope), 3),
        "ms_fixed": round(float(fixed), 3),
        "r2": round(1.0 - float(left @ left) / float(((y - y.mean()) ** 2).sum()), 4),
    }


def _memory_of_child(detector: str) -> float:
    done = subprocess.run(
        [sys.executable, "-m", "research.benchmarks.detector", "robot", detector],
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def robot_memory_mb(detector: str) -> float:
    """Largest resident memory of this process, after it has encoded like a robot."""
    torch.set_num_threads(1)
    world = Part(detector, TEST_SEEDS.start, None, 0, FRAMES).open()
    fusions = [make_fusion(name, detector) for name in fusion_names(detector)]
    for frame in range(MEMORY_FRAMES):
        scan = world.scan(world.robots[0], frame)
        for fusion in fusions:
            fusion.encode(scan.points, EncodeOptions(pose=scan.pose))
    status = Path("/proc/self/status").read_text()
    (peak,) = [line for line in status.splitlines() if line.startswith("VmHWM")]
    return int(peak.split()[1]) / 1e3


def _ms(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return (time.perf_counter() - begun) * 1e3


def _median(times: list[float]) -> float:
    return round(float(np.median(times)), 2)


if __name__ == "__main__":
    keep_freed_memory()
    if sys.argv[1:2] == ["robot"]:
        print(robot_memory_mb(sys.argv[2]))
    else:
        main()
