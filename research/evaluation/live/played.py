"""What a played window predicts for the frames that a real swarm published.

The ego's decisions are played frame for frame on a machine whose processors all robots and the ego
share, over the same link; a published frame is compared with what the contributions bring that are
in time there. Which of two robots is late in one frame is chance: a frame is predicted from all
frames that were played with its decision and in which the same robots are due.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from ego_agent.knowledge.compute import ComputeModel, Work, packaged_compute
from perception.fusion.base import Fusion
from perception.fusion.mixed import Mixed
from perception.fusion.registry import make_fusion
from perception.metrics import Match, match
from research.evaluation.live.stretches import Stretch, stretches
from research.evaluation.live.swarm import Recorded, boxes_of, evenly
from research.evaluation.windows.announcements import heard, snapshot
from research.evaluation.windows.frames import OnceWorld
from research.evaluation.windows.fused import IOUS, FusedFrame, fused_frame
from research.evaluation.windows.played import play
from research.evaluation.windows.precision import precision_of, shares
from research.evaluation.windows.scenarios import Scenario
from research.evaluation.windows.timing import Conditions, Played
from research.evaluation.windows.traffic import control_bps, left_bps
from swarm.messages import ALGORITHMS, Detections
from worlds.cooperative.fusing import SINGLE
from worlds.cooperative.judging import judge

IOU = 0.7
COMPARED = 40
"""Of all fused frames, evenly spread."""


@dataclass(frozen=True, slots=True)
class Machine:
    """What a swarm runs on."""

    compute: ComputeModel
    processors: int
    """That all robots and the ego share."""


def this_machine(compute: ComputeModel | None = None) -> Machine:
    """This machine, by that model of compute or the packaged one."""
    return Machine(compute or packaged_compute(), len(os.sched_getaffinity(0)))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Published frames beside played ones; None where none was published."""

    frames: int = 0
    """Compared for precision."""
    ap_70_live: float | None = None
    ap_70_played: float | None = None
    in_time_live: float | None = None
    """Contributions in time, of those that were due in the fused frames; 1 without any."""
    in_time_played: float | None = None
    fused_live: float | None = None
    """Frames fused, of those that were due at the decisions' rates."""
    fused_played: float | None = None
    latency_ms_p50_played: float | None = None
    """From the first query to the fused boxes, in milliseconds."""


def compare_played(
    scenario: Scenario, link_bps: int, recorded: Recorded, machine: Machine
) -> Comparison:
    """Plays what was recorded. Raises MessageError for boxes that cannot be read."""
    world = OnceWorld(scenario.open())
    parts = stretches(recorded, world.rate_hz)
    if not parts:
        return Comparison()
    player = _Player(world, link_bps, parts[0].frames[0], machine)
    windows = [player.play(part) for part in parts]
    due = [
        (frame, window.part.asked(frame.frame), window)
        for window in windows
        for frame in window.part.frames
    ]
    fused = [(one, window.asked[one.number]) for window in windows for one in window.played.fused()]
    compared = evenly(due, COMPARED)
    live: list[tuple[Match, float]] = []
    played: list[tuple[Match, float]] = []
    for frame, asked, window in compared:
        live.append((player.published(frame), 1.0))
        in_time = shares(window.in_time(asked))
        played += [(player.fused(frame, asked, who), weight) for who, weight in in_time.items()]
    frames_due = sum(part.due for part in parts)
    return Comparison(
        frames=len(compared),
        ap_70_live=precision_of(live),
        ap_70_played=precision_of(played),
        in_time_live=_ratio(
            sum(len(asked.keys() & {*frame.participants}) for frame, asked, _ in due),
            sum(len(asked) for _, asked, _ in due),
        ),
        in_time_played=_ratio(
            sum(len(one.in_time) for one, _ in fused), sum(len(asked) for _, asked in fused)
        ),
        fused_live=_ratio(len(due), frames_due),
        fused_played=_ratio(len(fused), frames_due),
        latency_ms_p50_played=float(np.median([1e3 * one.latency_s for one, _ in fused])),
    )


@dataclass(frozen=True, slots=True)
class _Window:
    """A stretch as it would go."""

    part: Stretch
    asked: tuple[Mapping[str, str], ...]
    """By number of the played frame: who is due, and with what."""
    played: Played

    def in_time(self, asked: Mapping[str, str]) -> list[tuple[str, ...]]:
        """Who of these is in time, in each played frame that asks for the same; where all of those
        were skipped, in each frame."""
        fused = self.played.fused()
        alike = [one for one in fused if self.asked[one.number] == asked]
        return [tuple(r for r in one.in_time if r in asked) for one in alike or fused]


class _Player:
    """Plays and fuses the frames of one swarm."""

    def __init__(
        self, world: OnceWorld, link_bps: float, first: Detections, machine: Machine
    ) -> None:
        self._world = world
        self._ego = first.ego
        self._machine = machine
        self._fusion = cache(self._make_fusion)
        fusions = {name: self._fusion(name) for name in ALGORITHMS}
        messages = heard(self._world, self._number(first), self._ego, fusions)
        control = control_bps(snapshot(self._ego, messages, link_bps))
        self._left_bps = left_bps(link_bps, control)

    def play(self, part: Stretch) -> _Window:
        """Payloads are as large as in the stretch's first frame."""
        forms = {one.robot: one.algorithm for one in part.assignments}
        sizes = self._frame(part.frames[0], forms, part.robots).bytes
        works = {form: self._work(form) for form in forms.values()}
        first = part.frames[0].frame
        asked = tuple(part.asked(first + number * part.step) for number in range(part.due))
        conditions = Conditions(
            work=max(works.values(), key=lambda work: work.fixed_ms, default=self._work(SINGLE)),
            cell_bps=lambda _: self._left_bps,
            processors=self._machine.processors,
            period_s=part.step / self._world.rate_hz,
            deadline_s=part.deadline_s,
            asked=[{robot: works[form] for robot, form in one.items()} for one in asked],
        )
        played = play(part.robots, part.due, lambda robot, _: sizes[robot], conditions)
        return _Window(part, asked, played)

    def fused(self, frame: Detections, asked: Mapping[str, str], robots: tuple[str, ...]) -> Match:
        """The frame, fused with these of the robots that were asked."""
        return self._frame(frame, asked, robots).matches[IOUS.index(IOU)]

    def published(self, frame: Detections) -> Match:
        """The frame as it was published."""
        boxes = boxes_of(frame)
        return match(*judge(self._world, self._number(frame), self._ego, boxes), IOU)

    def _frame(
        self, frame: Detections, asked: Mapping[str, str], robots: tuple[str, ...]
    ) -> FusedFrame:
        fusion: str | Fusion = SINGLE
        if robots:
            forms = {form: self._fusion(form) for form in sorted({*asked.values()})}
            first, *others = forms.values()
            sends = {robot: asked[robot] for robot in robots}
            fusion = Mixed(forms, sends) if others else first
        return fused_frame(self._world, self._number(frame), self._ego, robots, fusion, 0.0)

    def _work(self, algorithm: str) -> Work:
        return self._machine.compute.work(self._world.detector, algorithm)

    def _number(self, frame: Detections) -> int:
        return frame.frame % self._world.frame_count

    def _make_fusion(self, name: str) -> Fusion:
        return make_fusion(name, self._world.detector)


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else 1.0
