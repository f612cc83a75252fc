"""The best assignments of a drive, found by measuring: what is left to gain by deciding better.

The search knows what every way that it measured brought, which no policy can. It begins with the
best of nobody, the simplest rules and what `coverage` decides first, and changes what one robot
sends, PROBES times, at random; what is better stays. So what it finds is a lower bound of the best
that stays the same for a drive.

The best of many on few frames is partly luck. So the search goes by one half of a drive's frames
and is judged by the other, and the other way round: there luck does not count.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ego_agent.knowledge.objective import Objective
from perception.tally import Tally
from perception.types import Boxes
from research.evaluation.bootstrap import bootstrap_mean
from research.evaluation.machine import machine_facts
from research.evaluation.tables import markdown
from research.evaluation.ways.drive import Driven
from research.evaluation.ways.driven import DEFAULT, RULES, drive_of
from research.evaluation.ways.measure import SETTLED_FRAMES, Measured, measure
from research.evaluation.ways.planned import ALGORITHMS, RANDOM, Decided, Deciding
from research.evaluation.ways.sampling import (
    BETWEEN_HZ,
    OBJECTS_FROM_HZ,
    RATES_HZ,
    assignment,
)
from research.evaluation.ways.way import Way
from research.evaluation.windows.links import WINDOW_S, Link
from research.evaluation.windows.scenarios import Scenario
from research.evaluation.workers import each
from swarm.errors import EvaluationError
from swarm.files import write_whole
from swarm.messages import Assignment
from worlds.base import World

PROBES = 24
"""Changes that are tried by each half."""
NEAREST = 10
"""Robots whose contributions are changed; who is farther keeps what the search began with."""
ORACLE, HELD_OUT = "oracle", "oracle, held out"
POLICIES = (DEFAULT, *RULES, RANDOM)
"""What the oracle stands beside."""
HALVES = (0, 1)
Assignments = tuple[Assignment, ...]


@dataclass(frozen=True, slots=True)
class Value:
    """What a way brought in some frames of a drive."""

    ap_70: float
    value: float
    """AP@0.7 - lambda C: the objective with measured precision as Q."""
    bytes_per_frame: float


@dataclass(frozen=True, slots=True)
class Brought:
    """What a way brought on a drive."""

    whole: Value
    halves: tuple[Value, Value]
    """In the first half of its frames, and in the second; bytes and cost are the whole drive's."""
    feasible: bool
    """Whether the link carries all that was asked for."""


@dataclass(slots=True)
class _Halves:
    """Judges the halves of a drive, each by itself."""

    middle: int
    """The first frame of the second."""
    tallies: tuple[Tally, Tally] = field(default_factory=lambda: (Tally(), Tally()))

    def add(
        self, world: World, frame: int, told: Boxes, truth: Boxes, names: Sequence[str]
    ) -> None:
        """See `Watching`."""
        self.tallies[frame >= self.middle].add(told, truth, ())


class Trial:
    """Measures ways on one drive over one link."""

    def __init__(self, driven: Driven, link: Link, from_s: float, mean_bps: float) -> None:
        """`mean_bps`: of the link, during the drive."""
        self.driven = driven
        self._link, self._from_s, self._mean_bps = link, from_s, mean_bps
        self._objective = Objective(comm_range_m=driven.comm_range_m)
        self._known: dict[Assignments, Brought] = {}
        self._middle = driven.frames[(SETTLED_FRAMES + len(driven.frames)) // 2]

    def way(self, way: Way) -> Brought | None:
        """What it brings; None where a half holds no true box."""
        halves = _Halves(self._middle)
        measured = measure(self.driven, way, halves)
        if not all(one.precision().ground_truth for one in halves.tallies):
            return None
        rate_hz = self.driven.world.rate_hz
        wanted_bps = 8.0 * measured.wanted_bytes / max(1, measured.tally.frames) * rate_hz
        first, second = (self._value(one, measured) for one in halves.tallies)
        whole = self._value(measured.tally, measured)
        return Brought(whole, (first, second), wanted_bps <= self._mean_bps)

    def decided(self, policy: str) -> Brought | None:
        """What a policy brings that decides every second."""
        return self.way(self._over(policy, decided=Decided(policy, rarer=True)))

    def fixed(self, assignments: Assignments) -> Brought | None:
        """What these bring, all the drive."""
        if assignments not in self._known:
            found = self.way(self._over("fixed", assignments=assignments))
            if found is None:
                return None
            self._known[assignments] = found
        return self._known[assignments]

    def first_decided(self) -> Assignments:
        """What `coverage` decides as the drive begins."""
        link, from_s = self._link, self._from_s
        how = Decided(DEFAULT, rarer=True)
        deciding = Deciding(self.driven, how, lambda at_s: link.known_bps(from_s + at_s))
        deciding.asked(0, self.driven.frames[0])
        return tuple(sorted(deciding.assignments, key=lambda one: one.robot))

    @property
    def measured(self) -> Mapping[Assignments, Brought]:
        """Everything that stayed the same for a drive."""
        return self._known

    def _over(
        self, name: str, decided: Decided | None = None, assignments: Assignments = ()
    ) -> Way:
        return Way(
            name,
            link=self._link,
            link_from_s=self._from_s,
            decided=decided,
            assignments=assignments,
            in_turn=True,
        )

    def _value(self, tally: Tally, measured: Measured) -> Value:
        frames, due = max(1, measured.tally.frames), max(1, measured.due)
        ap_70, size = tally.precision().ap_70, measured.bytes / due
        work_s = measured.helping_ms / frames * 1e-3
        cost = self._objective.cost(size, self._mean_bps, work_s, self.driven.world.rate_hz)
        return Value(ap_70, ap_70 - cost, size)


def climb(trial: Trial, starts: Sequence[Assignments], half: int, seed: int) -> Assignments:
    """The best that was found by one half of the drive's frames."""
    rng = np.random.default_rng([seed, half])
    robots = trial.driven.in_range(trial.driven.frames[0])[:NEAREST]

    def value(assignments: Assignments) -> float:
        found = trial.fixed(assignments)
        return found.halves[half].value if found is not None and found.feasible else -np.inf

    top = max(starts, key=value)
    best = value(top)
    for _ in range(PROBES if robots else 0):
        robot = robots[int(rng.integers(len(robots)))]
        options = [one for one in sendable(robot, trial.driven.world.detector) if one not in top]
        others = tuple(one for one in top if one.robot != robot)
        # To leave a robot out is one change more of one that takes part.
        which = int(rng.integers(len(options) + (len(others) < len(top))))
        more = (options[which],) if which < len(options) else ()
        changed = tuple(sorted((*others, *more), key=lambda one: one.robot))
        found = value(changed)
        if found > best:
            top, best = changed, found
    return top


def sendable(robot: str, detector: str) -> Iterator[Assignment]:
    """What a robot may send to a fused frame: as an ego's options are."""
    between_hz, objects_from_hz = BETWEEN_HZ[detector], OBJECTS_FROM_HZ[detector]
    for form in ALGORITHMS:
        for hz in RATES_HZ:
            yield assignment(robot, form, hz, between_hz.get(hz, 0.0), objects_from_hz)


@dataclass(frozen=True, slots=True)
class _Item:
    scenario: Scenario
    window: int


def search(item: _Item) -> dict[str, list[Value]] | None:
    """What each of POLICIES, ORACLE and HELD_OUT brought in both halves of a scenario's window.
    None where a half holds no true box."""
    scenario, window = item.scenario, item.window
    driven, from_s = Driven(drive_of(scenario, window)), window * WINDOW_S
    detector = driven.world.detector
    mean_bps = scenario.link.mean_bps(from_s, from_s + len(driven.frames) / driven.world.rate_hz)
    trial = Trial(driven, scenario.link, from_s, mean_bps)
    near = sorted(driven.in_range(driven.frames[0]))
    rules = {
        name: tuple(
            assignment(
                robot, "early", hz, BETWEEN_HZ[detector][hz], OBJECTS_FROM_HZ[detector] * objects
            )
            for robot in near
        )
        for name, (hz, objects) in RULES.items()
    }
    rows = {policy: trial.decided(policy) for policy in (DEFAULT, RANDOM)}
    rows |= {name: trial.fixed(assignments) for name, assignments in rules.items()}
    starts = ((), *rules.values(), trial.first_decided())
    found: dict[str, list[Value]] = {}
    for name in POLICIES:
        one = rows[name]
        if one is None:
            return None
        found[name] = [*one.halves]
    tops = [climb(trial, starts, half, scenario.seed) for half in HALVES]
    found[HELD_OUT] = [trial.measured[tops[1 - half]].halves[half] for half in HALVES]
    possible = [one for one in trial.measured.values() if one.feasible]
    best = max(possible, key=lambda one: one.whole.value)
    found[ORACLE] = [*best.halves]
    return found


def compare(suite: Sequence[Scenario], workers: int, folder: Path) -> dict[str, Any]:
    """Searches on one window of each generated scenario; writes oracle.json and oracle.md into the
    folder and returns the figures.

    Raises EvaluationError where no scenario holds a true box, and when a process ends before its
    work is done.
    """
    items = [_Item(one, one.seed % one.windows) for one in suite]
    items.sort(key=lambda item: -item.scenario.robots)
    drives = []
    for place, one in each(search, items, workers, items[0].scenario.detector):
        if one is not None:
            drives.append(one)
        print(f"oracle: {items[place].scenario.name}", file=sys.stderr, flush=True)
    figures = table(drives)
    folder.mkdir(parents=True, exist_ok=True)
    whole = {**figures, "probes": PROBES, "machine": machine_facts()}
    write_whole(folder / "oracle.json", json.dumps(whole, indent=1) + "\n")
    write_whole(folder / "oracle.md", report(figures))
    return figures


def table(drives: Sequence[Mapping[str, Sequence[Value]]]) -> dict[str, Any]:
    """Means over drives, by halves, and each row beside DEFAULT's in pairs of drives, with 95 %
    bootstrap intervals. Raises EvaluationError where there is no drive."""
    if not drives:
        raise EvaluationError("no drive of these scenarios holds a true box in both halves")

    def means(drive: Mapping[str, Sequence[Value]], row: str, name: str) -> float:
        return float(np.mean([getattr(drive[row][half], name) for half in HALVES]))

    rows = []
    for row in (*POLICIES, ORACLE, HELD_OUT):
        figures: dict[str, Any] = {"policy": row}
        for name in ("ap_70", "value", "bytes_per_frame"):
            of_drives = [means(drive, row, name) for drive in drives]
            figures[name] = round(float(np.mean(of_drives)), 4)
            gaps = [
                one - means(drive, DEFAULT, name)
                for one, drive in zip(of_drives, drives, strict=True)
            ]
            if name != "bytes_per_frame":
                beside = bootstrap_mean(gaps)
                figures[f"{name}_beside"] = [
                    round(end, 4) for end in (beside.mean, beside.low, beside.high)
                ]
        rows.append(figures)
    return {"drives": len(drives), "rows": rows}


def report(figures: Mapping[str, Any]) -> str:
    """The figures as Markdown."""
    rows = markdown(
        ("", "AP@0.7", f"less {DEFAULT}'s", "kB/frame", "value", f"less {DEFAULT}'s"),
        [
            (
                one["policy"], f"{one['ap_70']:.3f}",
                "{:+.3f} [{:+.3f}, {:+.3f}]".format(*one["ap_70_beside"]),
                f"{one['bytes_per_frame'] / 1e3:.1f}", f"{one['value']:.3f}",
                "{:+.3f} [{:+.3f}, {:+.3f}]".format(*one["value_beside"]),
            )
            for one in figures["rows"]
        ],
    )  # fmt: skip
    parts = [
        "# The best assignments that were measured",
        f"{figures['drives']} drives of 5 s, judged by halves. Value: AP@0.7 - lambda C. Held out: "
        "the best by one half, judged by the other.",
        rows,
    ]
    return "\n\n".join(parts) + "\n"
