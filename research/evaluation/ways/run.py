"""Which rates, forms and codec settings are worth their bytes, with memory and without."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from research.evaluation.bootstrap import Interval, bootstrap_mean
from research.evaluation.machine import machine_facts
from research.evaluation.ways import narrow
from research.evaluation.ways.drive import Drive, Driven
from research.evaluation.ways.etsi import EtsiDriven
from research.evaluation.ways.measure import Measured, measure
from research.evaluation.ways.way import Way
from research.evaluation.workers import each
from research.training.plans import TEST_SEEDS
from swarm.errors import EvaluationError
from swarm.files import write_whole

WAYS_SEEDS = range(TEST_SEEDS.start + 900_000, TEST_SEEDS.start + 940_000)
"""Floors that nothing was trained, fitted or set on."""
FRAMES = 60
ROBOTS = 6
OURS = "early-1hz-places-5hz"
"""The fixed way that a fifth of the bytes was asked of; what an ego chooses by itself, at the usual
prices of bytes and compute, is measured by `driven` and by `narrow`."""
EVERYONE = "early-10hz-no-memory"
"""What others are compared with: everybody's points in every frame, no objects remembered."""
RULED = ETSI, MITIGATED = ("etsi", "etsi-mitigated")
"""The standard's messages, by its generation rules; without and with redundancy mitigation."""
TRACKING = ("mota", "idf1", "gospa_m", "identity_switches_per_track_minute")
RATES_HZ = (10.0, 5.0, 2.0, 1.0)
FORMS = ("early", "intermediate-codebook", "late")
COARSE_M = 0.25
LATE_FRAMES = (1, 3, 5)
NOISE_M = 0.2


def ways() -> tuple[Way, ...]:
    """What is compared."""
    static = [Way(f"{form}-{hz:g}hz", ((form, hz),)) for form in FORMS for hz in RATES_HZ]
    coarse = [
        Way(f"early-coarse-{hz:g}hz", (("early", hz),), max_error_m=COARSE_M) for hz in RATES_HZ
    ]
    alone = [
        Way(EVERYONE, (("early", 10.0),), memory=False),
        Way("early-5hz-no-memory", (("early", 5.0),), memory=False),
        Way("early-2hz-no-memory", (("early", 2.0),), memory=False),
        Way("nobody-no-memory", memory=False),
        Way("nobody"),
    ]
    turns = [
        Way(f"{form}-{hz:g}hz-in-turn", ((form, hz),), in_turn=True)
        for form, hz in (("early", 5.0), ("early", 2.0), ("early", 1.0), ("late", 5.0))
    ]
    focused = [
        narrow.static("early", hz, often)
        for hz, often in ((5.0, 10.0), (2.0, 10.0), (2.0, 5.0), (1.0, 10.0), (1.0, 5.0), (0.5, 5.0))
    ]
    objects = [narrow.static("objects", hz, often) for hz, often in ((5.0, 10.0), (2.0, 10.0))]
    mixed = [
        Way(
            f"mixed-{near}-{near_hz:g}hz-{far}-{far_hz:g}hz-in-turn",
            ((near, near_hz),) * count + ((far, far_hz),),
            in_turn=True,
        )
        for near, near_hz, count, far, far_hz in (
            ("early", 2.0, 3, "late", 5.0),
            ("early", 5.0, 2, "early", 2.0),
            ("early", 2.0, 3, "early", 1.0),
        )
    ]
    late = [
        Way(f"{form}-10hz-late-{frames / 10:g}s", ((form, 10.0),), late_frames=frames)
        for form in ("early", "late")
        for frames in LATE_FRAMES
    ]
    ruled = [Way(name, (("cpm", 10.0),)) for name in RULED]
    silent = [
        Way("silence", (("early", 10.0),), silent=(25, 10)),
        Way("silence-no-memory", (("early", 10.0),), memory=False, silent=(25, 10)),
    ]
    return (*alone, *static, *coarse, *turns, *focused, *objects, *mixed, *late, *ruled, *silent)


@dataclass(frozen=True, slots=True)
class _Item:
    drive: Drive
    ways: tuple[Way, ...]


def floors(count: int, frames: int, pose_noise_m: float = 0.0) -> list[Drive]:
    """That many factory floors; egos take turns."""
    return [
        Drive(
            world="factory",
            seed=WAYS_SEEDS.start + i,
            robots=ROBOTS,
            ego=i % ROBOTS,
            first=37 + i * 613 % 5000,
            frames=frames,
            pose_noise_m=pose_noise_m,
            pose_memory=True,
        )
        for i in range(count)
    ]


def recorded(folder: Path, frames: int) -> list[Drive]:
    """The first frames of an OPV2V scenario, from each of its vehicles."""
    from worlds.opv2v.world import Opv2vWorld

    world = Opv2vWorld(folder)
    count = min(world.frame_count, frames)
    robots = len(world.robots)
    return [Drive("opv2v", 0, robots, ego, 0, count, folder=folder) for ego in range(robots)]


def drive_all(item: _Item) -> list[Measured]:
    """What each way brings on a drive."""
    driven = Driven(item.drive)
    return [measure(_driven(driven, way), way) for way in item.ways]


def _driven(driven: Driven, way: Way) -> Driven:
    """The drive as a way has it: what stations of the standard tell depends on what they told."""
    if way.name not in RULED:
        return driven
    return EtsiDriven(driven.drive, mitigates=way.name == MITIGATED)


def links(count: int, frames: int, workers: int) -> dict[str, Any]:
    """What policies, static choices and chance bring on links that do not carry everything, by
    link, each on so many floors. Raises as `each` does."""
    found = {}
    for link in narrow.LINKS:
        items = [
            _Item(drive, narrow.ways(link))
            for drive in narrow.drives(link, WAYS_SEEDS, count, frames)
        ]
        parts = dict(each(drive_all, items, workers, "factory"))
        found[link.name] = narrow.table(link, [parts[at] for at in range(count)])
    return found


def compare(drives: Sequence[Drive], chosen: Sequence[Way], workers: int) -> dict[str, Any]:
    """Rows of all ways over the drives, each beside EVERYONE in pairs of drives.

    Raises EvaluationError where EVERYONE is not among the ways, and as `each` does.
    """
    if EVERYONE not in [way.name for way in chosen]:
        raise EvaluationError(f"ways are compared with {EVERYONE}, which is not among them")
    detector = "factory" if drives[0].world == "factory" else "road"
    items = [_Item(drive, tuple(chosen)) for drive in drives]
    parts: dict[int, list[Measured]] = dict(each(drive_all, items, workers, detector))
    by_way = {
        way.name: [parts[at][number] for at in range(len(drives))]
        for number, way in enumerate(chosen)
    }
    rows = [_row(way, by_way[way.name], by_way[EVERYONE], drives) for way in chosen]
    return {"rows": rows, "drives": len(drives), "frames": sum(drive.frames for drive in drives)}


def best_static(rows: Sequence[dict[str, Any]], ap_70: float) -> dict[str, Any]:
    """The row of one algorithm, codec setting and rate for all at once, with memory, that takes the
    fewest bytes of those that deliver as much to within 0.005; where none does, that delivers
    most."""
    singles = [r for r in rows if r["static"]]
    equal = [row for row in singles if row["ap_70"] >= ap_70 - 0.005]
    if not equal:
        return max(singles, key=lambda row: float(row["ap_70"]))
    return min(equal, key=lambda row: float(row["bytes_per_frame"]))


def _row(
    way: Way, parts: Sequence[Measured], everyone: Sequence[Measured], drives: Sequence[Drive]
) -> dict[str, Any]:
    whole = Measured()
    for at, part in enumerate(parts):
        whole.take_up(part, at)
    found = whole.tally.precision()
    more = bootstrap_mean(
        [
            a.tally.precision().ap_70 - b.tally.precision().ap_70
            for a, b in zip(parts, everyone, strict=True)
        ]
    )
    rate_hz = 10.0
    figures = {
        "ap_50": found.ap_50,
        "ap_70": found.ap_70,
        "recall": found.recall,
        "precision": found.precision,
        "false_per_frame": found.false_per_frame,
        "bytes_per_frame": whole.bytes / max(1, whole.tally.frames),
        "bytes_ratio": whole.bytes / max(1, sum(one.bytes for one in everyone)),
        "delivered_difference": more.mean,
        **whole.following.figures(rate_hz),
        "memory_ms_p50": float(np.median(whole.memory_ms)) if whole.memory_ms else 0.0,
    }
    return {
        "way": way.name,
        "forms": [list(form) for form in way.forms],
        "memory": way.memory,
        "max_error_m": way.max_error_m,
        "static": way.memory
        and len(way.forms) == 1
        and not (way.in_turn or way.silent or way.late_frames or way.name in RULED),
        **{name: round(value, 4) for name, value in figures.items()},
        "delivered_interval": _ends(more),
        "frames": whole.tally.frames,
        "ground_truth": found.ground_truth,
        **({"lost": whole.lost, "found_again": whole.found_again} if way.silent else {}),
    }


def _ends(interval: Interval) -> list[float]:
    return [round(interval.low, 4), round(interval.high, 4)]


def run(count: int, frames: int, data: Path | None, workers: int, path: Path) -> dict[str, Any]:
    """Compares on so many floors, with true poses and with noisy ones, and on a recorded scenario
    where there is one; writes everything to `path` and returns the figures.

    Raises as `compare` does, and WorldError for data that cannot be read.
    """
    names = (EVERYONE, OURS, ETSI, "early-10hz", "early-5hz", "early-2hz")
    few = [way for way in ways() if way.name in names or way.late_frames]
    compared = compare(floors(count, frames), ways(), workers)
    few_floors = max(1, count // 2)
    more = {
        "noise": compare(floors(few_floors, frames, NOISE_M), few, workers),
        "links": links(few_floors, frames, workers),
    }
    if data is not None:
        more["opv2v"] = compare(recorded(data, frames), few, workers)
    return report(compared, more, path)


def report(
    floors_compared: dict[str, Any], more: dict[str, dict[str, Any]], path: Path
) -> dict[str, Any]:
    """Writes the figures; `more`: comparisons of other drives, by name, and of `links`."""
    rows = floors_compared["rows"]
    row = {one["way"]: one for one in rows}
    ours, silent, best = row[OURS], row["silence"], best_static(rows, row[OURS]["ap_70"])
    figures = {
        "way": OURS,
        "bytes_ratio": ours["bytes_ratio"],
        "delivered_difference": ours["delivered_difference"],
        "delivered_interval": ours["delivered_interval"],
        "best_static": best["way"],
        "bytes_ratio_best_static": round(ours["bytes_per_frame"] / best["bytes_per_frame"], 4),
        "lost_found_ratio": round(silent["found_again"] / max(1, silent["lost"]), 4),
        "lost_found_ratio_no_memory": round(
            row["silence-no-memory"]["found_again"] / max(1, row["silence-no-memory"]["lost"]), 4
        ),
        "lost": silent["lost"],
        **{name: ours[name] for name in TRACKING},
        "ap_70_2hz_below_10hz": round(row["early-10hz"]["ap_70"] - row["early-2hz"]["ap_70"], 4),
    }
    for name, link in more.get("links", {}).items():
        for way, beside in link["beside"].items():
            best = beside["best_single_policy"]
            figures[f"{way}_{name}"] = [best["difference"], *best["interval"]]
    whole = {**figures, **floors_compared, **more, "machine": machine_facts()}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps(whole, indent=1) + "\n")
    return figures
