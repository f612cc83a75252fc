"""What robots and the ego need for a fused frame, by detector and algorithm, on one processor.

A robot encodes as it is asked; the ego begins, takes up the contributions of 1 and of 5 robots and
finishes: a line through both gives what a frame takes whoever takes part, and what each
contribution adds, medians over frames and rounds. `single` is the ego alone. Worlds of 6 robots.

Writes build/bench/compute.json, which is a model of compute (ego_agent/knowledge/compute.py) beside
the machine's facts and the samples; the packaged model is the `machine` and the `detectors` of one
such run.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ego_agent.knowledge.compute import SINGLE, ComputeModel, Work
from perception.fusion.base import Contribution, EncodeOptions, Fusion
from perception.fusion.detectors import shared_finder
from perception.fusion.publishing import publish
from perception.fusion.registry import fusion_names, make_fusion
from research.benchmarks.detector import one_core
from research.evaluation.machine import machine_facts
from research.evaluation.splits import nearest_first
from research.evaluation.windows.frames import OnceWorld
from research.training.plans import TEST_SEEDS
from swarm.files import write_whole
from swarm.memory import keep_freed_memory
from worlds.base import World
from worlds.cooperative.fusing import known_robots
from worlds.registry import open_world

PATH = Path("build/bench/compute.json")
DETECTORS = ("factory", "road")
ROBOTS = 6
FRAMES = (10, 40, 70)
ROUNDS = 5
FEW = 1
"""Contributions of the first of two points of the line; the second has all."""

Samples = dict[str, list[float]]


def main() -> None:
    """Measures, prints the model and writes it."""
    samples: dict[str, dict[str, Samples]] = {}
    with one_core():
        for detector in DETECTORS:
            world = OnceWorld(open_world(detector, robots=ROBOTS, seed=TEST_SEEDS.start))
            samples[detector] = {SINGLE: _alone(world)}
            for name in fusion_names(detector):
                samples[detector][name] = _with(world, make_fusion(name, detector))
                print(f"{detector} {name}", file=sys.stderr, flush=True)
    facts = machine_facts()
    model = ComputeModel(
        machine=facts["processor"],
        detectors={
            detector: {name: work_of(times) for name, times in by_algorithm.items()}
            for detector, by_algorithm in samples.items()
        },
    )
    figures: dict[str, Any] = msgspec.to_builtins(model)
    print(json.dumps(figures, indent=1))
    PATH.parent.mkdir(parents=True, exist_ok=True)
    report = {**figures, "machine_facts": facts, "samples": samples}
    write_whole(PATH, json.dumps(report, indent=1) + "\n")


def work_of(times: Samples) -> Work:
    """The model of one algorithm. times: milliseconds of `encode`, and of frames with `few` and
    `all` contributions; of the ego alone only `few`, with none."""
    few_ms = float(np.median(times["few"]))
    if "all" not in times:
        return Work(encode_ms=0.0, fixed_ms=round(few_ms, 2), add_ms=0.0)
    more_ms = np.subtract(times["all"], times["few"])
    add_ms = max(0.0, float(np.median(more_ms)) / (ROBOTS - 1 - FEW))
    return Work(
        encode_ms=round(float(np.median(times["encode"])), 2),
        fixed_ms=round(max(0.0, few_ms - FEW * add_ms), 2),
        add_ms=round(add_ms, 2),
    )


def _alone(world: World) -> Samples:
    finder = shared_finder(world.detector)
    scans = [world.scan(world.robots[0], frame).points for frame in FRAMES]
    finder.find(scans[0])  # imports and first allocations
    return {"few": [_ms(partial(finder.find, scan)) for _ in range(ROUNDS) for scan in scans]}


def _with(world: World, fusion: Fusion) -> Samples:
    times: Samples = {"encode": [], "few": [], "all": []}
    for number in range(1 + ROUNDS):
        for frame in FRAMES:
            encode_ms, sent = _encoded(world, fusion, frame)
            few = _ms(partial(_fuse, world, fusion, frame, sent[:FEW]))
            everyone = _ms(partial(_fuse, world, fusion, frame, sent))
            if number:  # The first round imports and allocates.
                times["encode"] += encode_ms
                times["few"].append(few)
                times["all"].append(everyone)
    return times


def _encoded(world: World, fusion: Fusion, frame: int) -> tuple[list[float], list[Contribution]]:
    """What each robot's encoding took, and what it sent, the nearest robot's first."""
    ego, *others = nearest_first(world, world.robots[0], frame)
    own = world.scan(ego, frame)
    ask = fusion.begin(own.points, own.pose.matrix()).ask()
    took_ms, sent = [], []
    for robot in others:
        scan = world.scan(robot, frame)
        options = EncodeOptions(pose=scan.pose, reference=ask.reference, demand=ask.demand)
        begun = time.perf_counter()
        payload = fusion.encode(scan.points, options)
        took_ms.append((time.perf_counter() - begun) * 1e3)
        sent.append(Contribution(robot, payload, scan.pose.matrix()))
    return took_ms, sent


def _fuse(world: World, fusion: Fusion, frame: int, sent: Sequence[Contribution]) -> None:
    """The ego's whole work on a frame, but for the waiting."""
    ego = world.robots[0]
    own = world.scan(ego, frame)
    gathering = fusion.begin(own.points, own.pose.matrix())
    gathering.ask()
    gathering.prepare()
    for contribution in sent:
        gathering.add(contribution)
    known = known_robots(world, frame, ego)
    publish(gathering.finish(), world.detector, fusion, len(sent), known)


def _ms(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return (time.perf_counter() - begun) * 1e3


if __name__ == "__main__":
    keep_freed_memory()
    main()
