"""What contributions that come less often bring, by algorithm, rate and speed of what they show:
everybody sends the same form at the same rate."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from perception.boxes import iou_bev
from perception.types import Boxes
from research.evaluation.machine import machine_facts
from research.evaluation.ways.drive import Drive, Driven
from research.evaluation.ways.measure import Measured, measure
from research.evaluation.ways.way import Way
from research.evaluation.workers import each
from research.training.plans import TEST_SEEDS
from swarm.files import write_whole
from worlds.base import World

AGING_SEEDS = range(TEST_SEEDS.start + 950_000, TEST_SEEDS.start + 970_000)
"""Floors and streets that nothing was trained, fitted or set on, and that test nothing else."""
ROBOTS = {"factory": 6, "road": 4}
FORMS = ("early", "intermediate", "late")
RATES_HZ = (10.0, 5.0, 2.0, 1.0, 0.5)
NOBODY = "nobody"
HIT_IOU = 0.7
STILL_M_S = 0.2
"""What is slower stands."""
SLOW_M_S = 1.0


@dataclass(slots=True)
class BySpeed:
    """How many of the true objects of each speed are told of in the right place."""

    there: dict[str, int] = field(default_factory=dict)
    hit: dict[str, int] = field(default_factory=dict)

    def add(
        self, world: World, frame: int, told: Boxes, truth: Boxes, names: Sequence[str]
    ) -> None:
        """One frame: told and true boxes, and whose the true ones are."""
        speeds = _speeds(world, frame)
        best = iou_bev(told, truth).max(axis=0, initial=0.0)
        for name, iou in zip(names, best.tolist(), strict=True):
            kind = _kind(speeds.get(name, 0.0))
            self.there[kind] = self.there.get(kind, 0) + 1
            self.hit[kind] = self.hit.get(kind, 0) + (iou >= HIT_IOU)

    def take_up(self, other: BySpeed) -> None:
        """Adds another drive."""
        for kind, count in other.there.items():
            self.there[kind] = self.there.get(kind, 0) + count
            self.hit[kind] = self.hit.get(kind, 0) + other.hit[kind]

    def shares(self) -> dict[str, float]:
        """Recall by speed."""
        return {kind: round(self.hit[kind] / n, 4) for kind, n in sorted(self.there.items())}


def _kind(speed_m_s: float) -> str:
    if speed_m_s < STILL_M_S:
        return "still"
    return "slow" if speed_m_s < SLOW_M_S else "fast"


def _speeds(world: World, frame: int) -> dict[str, float]:
    """Of every actor over the last frames, m/s."""
    back = max(0, frame - 2)
    then, now = world.ground_truth(back), world.ground_truth(frame)
    if back == frame:
        return {}
    places = dict(zip(then.ids, then.boxes.centers[:, :2], strict=True))
    return {
        name: float(np.hypot(*(center[:2] - places[name])) * world.rate_hz / (frame - back))
        for name, center in zip(now.ids, now.boxes.centers, strict=True)
        if name in places
    }


def rates() -> tuple[Way, ...]:
    """What is compared: everybody sends one form at one rate, in turn."""
    return (
        Way(NOBODY),
        *(
            Way(_name(form, hz), ((form, hz),), in_turn=True)
            for form in FORMS
            for hz in RATES_HZ
        ),
    )  # fmt: skip


def _name(form: str, hz: float) -> str:
    return f"{form}-{hz:g}hz"


def drives(detector: str, count: int, frames: int) -> list[Drive]:
    """That many floors or streets; egos take turns."""
    robots = ROBOTS[detector]
    return [
        Drive(
            world=detector,
            seed=AGING_SEEDS.start + i,
            robots=robots,
            ego=i % robots,
            first=41 + (i * 701 % 5000 if detector == "factory" else 0),
            frames=frames,
        )
        for i in range(count)
    ]


def drive_rates(drive: Drive) -> list[tuple[Measured, BySpeed]]:
    """What each rate brings on a drive."""
    driven, results = Driven(drive), []
    for way in rates():
        speeds = BySpeed()
        results.append((measure(driven, way, speeds), speeds))
    return results


def table(parts: Sequence[Sequence[tuple[Measured, BySpeed]]]) -> dict[str, Any]:
    """AP@0.7 and recall by speed of every rate over drives, and what each is worth of ten a
    second. `parts`: by drive, then by rate as `rates` has them."""
    rows: dict[str, dict[str, Any]] = {}
    for number, way in enumerate(rates()):
        whole, speeds = Measured(), BySpeed()
        for at, part in enumerate(parts):
            whole.take_up(part[number][0], at)
            speeds.take_up(part[number][1])
        found = whole.tally.precision()
        rows[way.name] = {
            "ap_70": round(found.ap_70, 4),
            "ap_50": round(found.ap_50, 4),
            "recall_70": speeds.shares(),
            "bytes_per_frame": round(whole.bytes / max(1, whole.tally.frames), 1),
            "frames": whole.tally.frames,
        }
    return {"rows": rows, "drives": len(parts)}


def run(counts: Mapping[str, int], frames: int, workers: int, path: Path) -> None:
    """Measures so many drives with each detector; writes everything to `path`. Raises as `each`
    does."""
    found: dict[str, Any] = {}
    for detector, count in counts.items():
        items = drives(detector, count, frames)
        parts = dict(each(drive_rates, items, workers, detector))
        found[detector] = table([parts[at] for at in range(count)])
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps({**found, "machine": machine_facts()}, indent=1) + "\n")
