"""Precision and bytes of every fusion algorithm: clean, with noisy poses, with delay, with fewer
robots."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from perception.detector.weight_files import has_weights
from perception.fusion.base import Fusion
from perception.fusion.registry import fusion_names, make_fusion
from perception.tally import CLASS_KEYS, Tally
from research.evaluation.machine import machine_facts
from research.evaluation.result_store import ResultStore
from research.evaluation.sharing import RememberingFusion
from research.evaluation.splits import ROBOTS, WORLDS, Part, nearest_first, recorded, simulated
from research.evaluation.uncoded import EARLY_UNCODED, UncodedEarly
from research.evaluation.workers import each
from swarm.errors import PerceptionError, WorldError
from swarm.files import write_whole
from worlds.cooperative.fusing import SINGLE, Disturbance, fuse_frame
from worlds.cooperative.judging import add_frame
from worlds.sample import opv2v_sample

DETECTORS = {"factory": "factory", "road": "road", "opv2v": "road"}
POSE_SIGMAS_M = (0.2, 0.4, 0.6)
UNCORRECTED_M = (0.0, 0.4)
"""What the correction costs and saves is shown at these."""
DELAYS_S = (0.1, 0.3, 0.5)
CLEAN = Disturbance()
MADE_FROM = (
    "research/evaluation/detector.py",
    "research/evaluation/sharing.py", "research/evaluation/splits.py",
    "research/evaluation/uncoded.py",
    "perception", "swarm/geometry.py", "worlds",
)  # fmt: skip
"""What decides the tally of a part."""
AP_KEYS = ("ap_30", "ap_50", "ap_70")
TYPICAL = ("early", "late", "intermediate")
"""Algorithms that are also measured with every number of robots, and without correction."""


@dataclass(frozen=True, slots=True)
class Case:
    """One row."""

    algorithm: str
    robots: int
    """The ego and its nearest."""
    disturbance: Disturbance = CLEAN
    corrected: bool = True
    """Whether the ego corrects the senders' poses."""


def algorithms_of(world: str) -> tuple[str, ...]:
    """What can be measured on a world of that name."""
    return (SINGLE, *fusion_names(DETECTORS[world]), EARLY_UNCODED)


def cases(world: str, algorithms: Sequence[str]) -> list[Case]:
    """The rows of a world, as far as they are of the given algorithms."""
    most = ROBOTS[world]
    fusions = [name for name in fusion_names(DETECTORS[world]) if name in algorithms]
    rows = [Case(SINGLE, 1)] if SINGLE in algorithms else []
    rows += [Case(name, most) for name in fusions]
    rows += [Case(EARLY_UNCODED, most)] if EARLY_UNCODED in algorithms else []
    for name in fusions:
        rows += [Case(name, most, Disturbance(pose_noise_m=sigma)) for sigma in POSE_SIGMAS_M]
        rows += [Case(name, most, Disturbance(delay_s=delay)) for delay in DELAYS_S]
    for name in (name for name in fusions if name in TYPICAL):
        rows += [
            Case(name, most, Disturbance(pose_noise_m=sigma), corrected=False)
            for sigma in UNCORRECTED_M
        ]
        rows += [Case(name, n) for n in range(2, most)]
    return rows


def measure(part: Part, rows: Sequence[Case]) -> list[Tally]:
    """The tally of each row over the frames of one part."""
    world = part.open()
    ego = world.robots[part.ego]
    fusions = {
        kind: _fusion(*kind, world.detector) for kind in {(r.algorithm, r.corrected) for r in rows}
    }
    tallies = [Tally() for _ in rows]
    # Rows of one disturbance share feature maps, which are kept for a while.
    order = sorted(zip(rows, tallies, strict=True), key=lambda pair: astuple(pair[0].disturbance))
    for frame in part.frames:
        robots = nearest_first(world, ego, frame)
        for row, tally in order:
            fusion = fusions[row.algorithm, row.corrected]
            fused = fuse_frame(world, frame, ego, robots[: row.robots], fusion, row.disturbance)
            add_frame(tally, world, frame, ego, fused)
    return tallies


def run(
    worlds: Sequence[str],
    algorithms: Sequence[str] | None,
    frames: int,
    workers: int,
    report: Path,
) -> None:
    """Measures the rows of the worlds and writes the report; progress goes to standard error.

    `algorithms`: all when None; `frames`: of each simulated world; `workers`: processes. Raises
    WorldError for an unknown world, PerceptionError for an algorithm that none of the worlds has,
    and WorldError when nothing could be measured. What is finished is kept beside the report, for a
    run that goes on after this one was ended.
    """
    for world in worlds:
        if world not in WORLDS:
            raise WorldError(f"world {world!r} is not known; allowed: {', '.join(WORLDS)}")
    allowed = list(dict.fromkeys(name for world in worlds for name in algorithms_of(world)))
    for name in algorithms or ():
        if name not in allowed:
            raise PerceptionError(
                f"algorithm {name!r} is not available; allowed: {', '.join(allowed)}"
            )
    rows: list[dict[str, Any]] = []
    speed: dict[str, float] = {}
    skipped: dict[str, str] = {}
    for world in worlds:
        try:
            parts = (
                recorded(opv2v_sample(), frames) if world == "opv2v" else simulated(world, frames)
            )
        except WorldError as error:
            skipped[world] = str(error)
            print(f"{world}: skipped: {error}", file=sys.stderr, flush=True)
            continue
        wanted = cases(world, algorithms or allowed)
        if not wanted:
            continue
        begun = time.monotonic()
        tallies, fresh = _over_parts(
            world, parts, wanted, workers, ResultStore(report.parent / "kept", MADE_FROM)
        )
        if fresh:
            speed[world] = round(fresh / (time.monotonic() - begun), 3)
        rows += [_row(world, case, tally) for case, tally in zip(wanted, tallies, strict=True)]
        _write(report, rows, speed, skipped)
    if not rows:
        raise WorldError(f"nothing was measured: {skipped}")
    print(f"wrote {report}", file=sys.stderr)


def _over_parts(
    world: str, parts: Sequence[Part], rows: Sequence[Case], workers: int, kept: ResultStore
) -> tuple[list[Tally], int]:
    """The tally of each row over all parts, and the number of frames that were not kept from a run
    before. Finished parts of simulated worlds are kept; a recorded one is quickly measured."""
    found = [None if part.folder else kept.get(_key(part, rows)) for part in parts]
    measured = [
        None if one is None else [Tally.unpacked(values) for values in one] for one in found
    ]
    missing = [at for at, one in enumerate(measured) if one is None]
    count, fresh = sum(len(part.frames) for part in parts), 0
    left = sum(len(parts[at].frames) for at in missing)
    begun = time.monotonic()
    work = partial(measure, rows=rows)
    for place, tallies in each(work, [parts[at] for at in missing], workers, DETECTORS[world]):
        part = parts[missing[place]]
        measured[missing[place]] = tallies
        if part.folder is None:
            kept.put(_key(part, rows), [tally.packed() for tally in tallies])
        fresh, left = fresh + len(part.frames), left - len(part.frames)
        rate = fresh / (time.monotonic() - begun)
        print(
            f"{world}: {count - left}/{count} frames, {len(rows)} rows, {rate:.2f} frames/s, "
            f"{left / rate / 60:.0f} min left",
            file=sys.stderr,
            flush=True,
        )
    # In the order of the parts: AP as OpenCOOD counts it depends on it.
    totals = [Tally() for _ in rows]
    for one in measured:
        for total, tally in zip(totals, one or (), strict=True):
            total.take_up(tally)
    return totals, fresh


def _key(part: Part, rows: Sequence[Case]) -> str:
    return f"detector {part} {list(rows)}"


def _fusion(algorithm: str, corrected: bool, detector: str) -> Fusion | str:
    if algorithm == SINGLE:
        return SINGLE
    if algorithm == EARLY_UNCODED:
        return UncodedEarly(detector)
    fusion = make_fusion(algorithm, detector)
    fusion.corrects = corrected
    return RememberingFusion(fusion)


def _row(world: str, case: Case, tally: Tally) -> dict[str, Any]:
    per_frame = tally.precision(per_frame=True)
    return {
        "world": world,
        "algorithm": case.algorithm,
        "robots": case.robots,
        "pose_sigma_m": case.disturbance.pose_noise_m,
        "delay_s": case.disturbance.delay_s,
        "corrected": case.corrected,
        **tally.precision().figures(),
        "per_frame": per_frame.figures(*AP_KEYS),
        "classes": {label: one.figures(*CLASS_KEYS) for label, one in tally.classes().items()},
        "detector": "learned" if has_weights(DETECTORS[world]) else "clustered",
    }


def _write(
    path: Path, rows: list[dict[str, Any]], speed: dict[str, float], skipped: dict[str, str]
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    report = {
        "rows": rows,
        "frames_per_s": speed,
        "skipped": skipped,
        "machine": machine_facts(),
    }
    write_whole(path, json.dumps(report, indent=1) + "\n")
