"""The closed loop: how soon a decision whose contributions arrive follows a narrow link, and what
learning is worth while links and loads change.

A swarm of six robots in network namespaces, twice with the same schedule on the same frames of the
factory: with learning, and without (`COADAPT_LEARN=0`), which is the control. First the case of
README: the cell is shaped from 55 to 1 Mbit/s. Then the schedule: segments of 15 s with other
rates, in some of which a process keeps one core busy, or some robots get a tenth of a processor.

`cycles`: from shaping to the first decision of which, and of the four after it together, at least
0.9 of the contributions are in time. `in_time_ratio`: contributions in time by robots asked, over
the schedule. Delivered AP: what a reader of the ego's detections has of each second frame, the
newest objects of at most a second ago, moved by their own velocities, as the ego remembers them
where it does, else its boxes; they are matched at IoU 0.7 with the truth of that frame. Value is
that less lambda C, at the prices of the objective: what came, over the cell's rate, and what the
requests took of processors, by the model of compute in both runs. Both are compared window by
window of 5 s, on the same frames; the intervals draw whole segments again.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from deploy.paths import journal_path
from deploy.rates import parse_rate
from deploy.state import State
from ego_agent.knowledge.compute import packaged_compute
from ego_agent.knowledge.objective import Objective
from perception.detector import configuration
from perception.fusion.tracks import Tracks
from perception.metrics import Match, match, precision_of
from perception.types import Boxes
from research.benchmarks.live import ROBOTS, live_swarm, process_id, why_not
from research.benchmarks.report import write_report
from research.evaluation.bootstrap import bootstrap_mean
from swarm.arrays import Array, unpack_finite
from swarm.listening import listen
from swarm.messages import Detections
from swarm.messages import Tracks as RememberedObjects
from worlds.base import World
from worlds.cooperative.judging import judge
from worlds.registry import open_world

Load = Literal["", "core", "robots"]
SCHEDULE: tuple[tuple[str, Load], ...] = (
    ("5mbit", ""),
    ("1mbit", "core"),
    ("20mbit", "robots"),
    ("1mbit", ""),
    ("2mbit", "core"),
    ("10mbit", "robots"),
)
"""(rate of the cell, what is busy), again and again."""
SLOW = ("R3", "R5")
"""The robots that are slow then: near the ego, so it would ask them."""
TURN_S, RUNS_S = 0.2, 0.02
"""A slow robot's process runs for so much of each turn."""
SEGMENT_S, WINDOW_S = 15.0, 5.0
BEGIN_S = 45.0
"""From the first frame to README's case: the swarm has been up for a while then."""
CASE_S = 20.0
CASE_RATE = "1mbit"
ARRIVES, TOGETHER = 0.9, 5
HELD_S = 1.0
"""Older boxes are shown to nobody."""
STEP = 2
"""Frames from one that is scored to the next."""
IOU = 0.7
BUSY = "while True: pass"
NOT_ASKED = ("busy", "offline", "left", "probe")
"""Why a robot is missing that did not work for the frame."""


@dataclass
class Run:
    """What one run left."""

    epoch_ns: int
    frames: list[Detections] = field(default_factory=list)
    cycles: list[dict[str, Any]] = field(default_factory=list)
    """The journal's lines."""
    shaped_ns: int = 0


@contextmanager
def busy_core() -> Iterator[None]:
    """A process that takes what it can get of one core."""
    process = subprocess.Popen([sys.executable, "-c", BUSY])
    try:
        yield
    finally:
        process.kill()
        process.wait()


@contextmanager
def slow_robots(state: State) -> Iterator[None]:
    """Some robots' processes get a tenth of a processor: between they are stopped."""
    pids = [process_id(state, "robot_agent", COADAPT_ROBOTS=robot) for robot in SLOW]
    over = threading.Event()
    ended: list[str] = []

    def send(number: int) -> None:
        for robot, pid in zip(SLOW, pids, strict=True):
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                ended.append(robot)

    def turns() -> None:
        while not over.wait(RUNS_S):
            send(signal.SIGSTOP)
            over.wait(TURN_S - RUNS_S)
            send(signal.SIGCONT)

    thread = threading.Thread(target=turns)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        send(signal.SIGCONT)
    if ended:
        raise RuntimeError(f"ended while they were slow: {', '.join(sorted({*ended}))}")


def loaded(load: Load, state: State) -> AbstractContextManager[None]:
    """What is busy in a segment, until left."""
    if load == "core":
        return busy_core()
    return slow_robots(state) if load == "robots" else nullcontext()


def shape(swarm: str, rate: str) -> None:
    """Has the controller shape the cell."""
    command = ("net", "shape", "--rate", rate, "--swarm", swarm, "--json")
    subprocess.run(
        [sys.executable, "-m", "coadapt.main", *command], check=True, stdout=subprocess.DEVNULL
    )


def wait_until(run: Run, second: float) -> None:
    """Sleeps until so many seconds after the first frame."""
    time.sleep(max(0.0, run.epoch_ns * 1e-9 + second - time.time()))


def perform(learn: bool, seconds: float) -> Run:
    """One run: README's case, then the schedule."""
    run = Run(time.time_ns())
    settings = {"COADAPT_LEARN": "true" if learn else "false"}
    swarm = "loop-learn" if learn else "loop-control"
    with live_swarm(swarm, settings, epoch_ns=run.epoch_ns) as state, listening(state, run):
        wait_until(run, BEGIN_S)
        run.shaped_ns = time.time_ns()
        shape(swarm, CASE_RATE)
        at_s = BEGIN_S + CASE_S
        wait_until(run, at_s)
        for number in range(round(seconds / SEGMENT_S)):
            rate, load = SCHEDULE[number % len(SCHEDULE)]
            shape(swarm, rate)
            at_s += SEGMENT_S
            with loaded(load, state):
                wait_until(run, at_s)
        journal = Path(journal_path(state.spec, state.spec.var_dir)).read_text()
    run.cycles = [json.loads(line) for line in journal.splitlines() if line.endswith("}")]
    return run


@contextmanager
def listening(state: State, run: Run) -> Iterator[None]:
    """Keeps what the ego publishes."""
    swarm, ego = state.spec.swarm, state.spec.ego
    with listen(state.router, swarm, {Detections: run.frames.append}, ego, timeout_s=10.0):
        yield


def cycles_to_arrive(run: Run) -> int | None:
    """Cycles from shaping to a decision whose contributions arrive; None where none came."""
    end_ns = run.shaped_ns + round(CASE_S * 1e9)
    after = [line for line in run.cycles if run.shaped_ns < line["started_ns"] < end_ns]
    counts = [asked_and_in_time(line) for line in after]
    for first in range(len(counts)):
        asked, came = np.sum(counts[first : first + TOGETHER], axis=0)
        if counts[first][0] and came >= ARRIVES * asked:
            return first + 1
    return None


def asked_and_in_time(line: dict[str, Any]) -> tuple[int, int]:
    """Robots that the frames of a cycle were to have, and those that were in them."""
    asked = line["frames"]["fused"] * (len(line["decision"]["participants"]) - 1)
    return asked, asked - sum(n for by_kind in line["missing"].values() for n in by_kind.values())


def scheduled(run: Run, world: World, seconds: float) -> list[Detections]:
    """The detections of the schedule's frames."""
    first = round((BEGIN_S + CASE_S) * world.rate_hz)
    last = first + round(seconds * world.rate_hz)
    return [frame for frame in run.frames if first <= frame.frame < last]


def changes_per_min(run: Run) -> float:
    """Changes of the decision over the schedule."""
    lines = [line["decision"] for line in of_schedule(run)]
    choices = [(sorted(d["participants"]), d["algorithm"], d["rate_hz"]) for d in lines]
    return 60.0 * sum(a != b for a, b in pairwise(choices)) / max(1, len(choices))


def asked_bytes_s(run: Run) -> float:
    """Bytes a second that decisions of the schedule take: mean over cycles."""
    decisions = [line["decision"] for line in of_schedule(run)]
    return float(np.mean([one["cost_bytes"] * one["rate_hz"] for one in decisions]))


def of_schedule(run: Run) -> list[dict[str, Any]]:
    """The journal's lines of the schedule."""
    begin_ns = run.epoch_ns + round((BEGIN_S + CASE_S) * 1e9)
    return [line for line in run.cycles if line["started_ns"] >= begin_ns]


def in_time_ratio(frames: Sequence[Detections]) -> float:
    """Share of the contributions asked for that were in time; NaN where nobody was asked."""
    came = sum(len(frame.participants) - 1 for frame in frames)
    asked = came + sum(len(frame.missing) for frame in frames)
    return came / asked if asked else float("nan")


def nobody_asked(frame: Detections) -> bool:
    """Whether the ego went alone."""
    return len(frame.participants) + len(frame.missing) == 1


class Reader:
    """What somebody who reads a run's detections knows of a moment."""

    def __init__(self, run: Run, world: World) -> None:
        self._frames = sorted(run.frames, key=lambda frame: frame.frame)
        self._tracks = Tracks(configuration(world.detector).usual_speed_m_s)
        self._shown: tuple[float, Boxes, np.ndarray] | None = None
        self._rate_hz = world.rate_hz
        self._next = 0

    def at(self, frame: int) -> Boxes:
        """The boxes for a frame; frames must rise."""
        while self._next < len(self._frames) and self._frames[self._next].frame <= frame:
            message = self._frames[self._next]
            self._next += 1
            time_s = message.frame / self._rate_hz
            if message.tracks is not None:
                self._shown = time_s, *remembered(message.tracks)
            else:
                boxes = boxes_of(message)
                self._shown = time_s, boxes, self._tracks.update(boxes, time_s)
        if self._shown is None:
            return Boxes.empty()
        time_s, boxes, velocities = self._shown
        ago_s = frame / self._rate_hz - time_s
        if ago_s > HELD_S:
            return Boxes.empty()
        centers = boxes.centers.copy()
        centers[:, :2] += velocities * ago_s
        return replace(boxes, centers=centers)


def remembered(tracks: RememberedObjects) -> tuple[Boxes, NDArray[np.float64]]:
    """What an ego remembers, in the world frame, with velocities (N, 2), m/s."""
    boxes = _boxes(tracks.boxes, tracks.scores, tracks.labels)
    return boxes, unpack_finite(tracks.velocities, "velocities", 2).astype(np.float64)


def boxes_of(message: Detections) -> Boxes:
    """The boxes of a message, in the world frame."""
    return _boxes(message.boxes, message.scores, message.labels)


def _boxes(boxes: Array, scores: Array, labels: tuple[str, ...]) -> Boxes:
    table = unpack_finite(boxes, "boxes", 7).astype(np.float64)
    likely = unpack_finite(scores, "scores", 1)[:, 0].astype(np.float64)
    return Boxes(table[:, :3], table[:, 3:6], table[:, 6], likely, labels)


def delivered(runs: Sequence[Run], world: World, ego: str, seconds: float) -> list[list[float]]:
    """AP of each window, run by run."""
    readers = [Reader(run, world) for run in runs]
    first = round((BEGIN_S + CASE_S) * world.rate_hz)
    length = round(WINDOW_S * world.rate_hz)
    found: list[list[float]] = [[] for _ in runs]
    for begin in range(first, first + round(seconds * world.rate_hz), length):
        matches: list[list[Match]] = [[] for _ in runs]
        for frame in range(begin, begin + length, STEP):
            for reader, kept in zip(readers, matches, strict=True):
                boxes = reader.at(frame)
                kept.append(match(*judge(world, frame, ego, boxes), IOU))
        for kept, windows in zip(matches, found, strict=True):
            windows.append(precision_of(kept))
    return found


def costs(run: Run, world: World, seconds: float) -> list[float]:
    """lambda C of each window, by the objective's prices; bytes are those that came in time."""
    objective, compute = Objective(), packaged_compute()
    length = round(WINDOW_S * world.rate_hz)
    count = round(seconds / WINDOW_S)
    sent, worked_s = np.zeros(count), np.zeros(count)
    begin = round((BEGIN_S + CASE_S) * world.rate_hz)
    decided = {line["cycle"]: line["decision"] for line in run.cycles}
    for frame in scheduled(run, world, seconds):
        if frame.cycle not in decided:
            continue  # The last cycle's line was never written.
        decision = decided[frame.cycle]
        forms = {one["robot"]: one["algorithm"] for one in decision["assignments"]}
        window = (frame.frame - begin) // length
        sent[window] += sum(frame.bytes.values())
        for robot in {*frame.participants[1:], *frame.missing}:
            if frame.missing_kinds.get(robot) in NOT_ASKED:
                continue
            work = compute.work(world.detector, forms.get(robot, decision["algorithm"]))
            worked_s[window] += (work.encode_ms + work.add_ms) * 1e-3
    found = []
    for window in range(count):
        rate, _ = SCHEDULE[int(window * WINDOW_S // SEGMENT_S) % len(SCHEDULE)]
        of_frame = sent[window] / length, parse_rate(rate), worked_s[window] / length
        found.append(objective.cost(*of_frame, world.rate_hz))
    return found


def main() -> int:
    """Measures and writes build/bench/loop.json."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument(
        "--seconds", type=float, default=90.0, help="of the schedule (default: 90, all of it once)"
    )
    seconds = max(SEGMENT_S, parser.parse_args().seconds // SEGMENT_S * SEGMENT_S)
    if trouble := why_not():
        print(f"loop: left out, no swarm can run here: {trouble}", file=sys.stderr)
        return 0
    runs = [perform(learn, seconds) for learn in (True, False)]
    world = open_world("factory", robots=ROBOTS)
    learnt, control = delivered(runs, world, world.robots[0], seconds)
    segments = [int(i * WINDOW_S // SEGMENT_S) for i in range(len(learnt))]
    gain = bootstrap_mean([a - b for a, b in zip(learnt, control, strict=True)], segments)
    cost, cost_control = (costs(run, world, seconds) for run in runs)
    worth = np.subtract(learnt, cost) - np.subtract(control, cost_control)
    value = bootstrap_mean([*worth], segments)
    frames = [scheduled(run, world, seconds) for run in runs]
    figures = {
        "cycles": cycles_to_arrive(runs[0]),
        "cycles_control": cycles_to_arrive(runs[1]),
        "in_time_ratio": in_time_ratio(frames[0]),
        "in_time_ratio_control": in_time_ratio(frames[1]),
        "delivered_ap": float(np.mean(learnt)),
        "delivered_ap_control": float(np.mean(control)),
        "delivered_gain": gain.mean,
        "delivered_gain_low": gain.low,
        "delivered_gain_high": gain.high,
        "value_gain": value.mean,
        "value_gain_low": value.low,
        "value_gain_high": value.high,
        "asked_bytes_per_s": asked_bytes_s(runs[0]),
        "asked_bytes_per_s_control": asked_bytes_s(runs[1]),
        "fps": len(frames[0]) / seconds,
        "fps_control": len(frames[1]) / seconds,
        "alone_ratio": float(np.mean([nobody_asked(frame) for frame in frames[0]])),
        "changes_per_min": changes_per_min(runs[0]),
        "seconds": seconds,
        "rows": [
            {
                "window": i,
                "rate": rate,
                "busy": load,
                "ap": a,
                "ap_control": b,
                "cost": c,
                "cost_control": d,
            }
            for i, (s, a, b, c, d) in enumerate(
                zip(segments, learnt, control, cost, cost_control, strict=True)
            )
            for rate, load in (SCHEDULE[s % len(SCHEDULE)],)
        ],
    }
    samples = {
        name: [
            {
                "cycle": line["cycle"],
                "second": round((line["started_ns"] - run.epoch_ns) * 1e-9, 1),
                "decision": line["decision"],
                "frames": line["frames"],
                "missing": line["missing"],
                "capacity_bps": line["inputs"]["capacity_bps"],
            }
            for line in run.cycles
        ]
        for name, run in zip(("learn", "control"), runs, strict=True)
    }
    print(write_report("loop", figures, samples))
    print({key: value for key, value in figures.items() if key != "rows"})
    return 0


if __name__ == "__main__":
    sys.exit(main())
