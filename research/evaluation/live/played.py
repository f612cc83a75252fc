"""What a played window predicts for the frames that a real swarm published.

The ego's decisions are played frame for frame on a machine whose processors all robots and the ego
share, over the same link; a published frame is compared with what the contributions bring that are
in time there. Which of two robots is late in one frame is chance: a frame is predicted from all
frames that were played with its decision.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from ego_agent.knowledge.compute import ComputeModel, packaged_compute
from ego_agent.knowledge.pace import USUAL
from perception.fusion.base import Fusion
from perception.fusion.registry import make_fusion
from perception.metrics import Match, match
from research.evaluation.live.swarm import Recorded, boxes_of
from research.evaluation.sharing import RememberingFusion
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
class Stretch:
    """Consecutive published frames of one decision."""

    frames: tuple[Detections, ...]
    robots: tuple[str, ...]
    """Who was to take part, apart from the ego."""
    deadline_s: float

    @property
    def step(self) -> int:
        """Sensor frames from one frame that is asked for to the next, at the decision's rate."""
        numbers = [frame.frame for frame in self.frames]
        return min((b - a for a, b in pairwise(numbers) if b > a), default=1)

    @property
    def due(self) -> int:
        """Frames that could have been asked for from the first to the last."""
        return 1 + (self.frames[-1].frame - self.frames[0].frame) // self.step


@dataclass(frozen=True, slots=True)
class Comparison:
    """Published frames beside played ones; None where none was published."""

    frames: int = 0
    """Compared for precision."""
    ap_70_live: float | None = None
    ap_70_played: float | None = None
    in_time_live: float | None = None
    """Contributions in time, of those that the fused frames could have had; 1 without any."""
    in_time_played: float | None = None
    fused_live: float | None = None
    """Frames fused, of those that were due at the decisions' rates."""
    fused_played: float | None = None
    latency_ms_p50_played: float | None = None
    """From the first query to the fused boxes, in milliseconds."""


def stretches(recorded: Recorded) -> list[Stretch]:
    """The published frames by decision; one that was not heard is told by its frames."""
    decided = {decision.cycle: decision for decision in recorded.decisions}
    found: list[Stretch] = []
    last: tuple[object, ...] = ()
    for frame in recorded.frames:
        decision = decided.get(frame.cycle)
        named = decision.participants if decision else (*frame.participants, *frame.missing)
        robots = tuple(sorted({*named} - {frame.ego}))
        deadline_s = (decision and decision.deadline_s) or USUAL.deadline_s
        rate_hz = decision.rate_hz if decision else USUAL.rate_hz
        key = (robots, frame.algorithm, deadline_s, rate_hz)
        if found and key == last:
            found[-1] = replace(found[-1], frames=(*found[-1].frames, frame))
        else:
            found.append(Stretch((frame,), robots, deadline_s))
        last = key
    return found


def compare_played(
    scenario: Scenario, link_bps: float, recorded: Recorded, machine: Machine
) -> Comparison:
    """Plays what was recorded. Raises MessageError for boxes that cannot be read."""
    if not recorded.frames:
        return Comparison()
    player = _Player(scenario, link_bps, recorded.frames[0], machine)
    parts = stretches(recorded)
    windows = [player.play(part) for part in parts]
    expected = [window for part, window in zip(parts, windows, strict=True) for _ in part.frames]
    compared = np.linspace(0, len(expected) - 1, min(COMPARED, len(expected))).astype(int).tolist()
    live: list[tuple[Match, float]] = []
    played: list[tuple[Match, float]] = []
    for at in compared:
        frame = recorded.frames[at]
        live.append((player.published(frame), 1.0))
        in_time = shares([one.in_time for one in expected[at].fused()])
        played += [(player.fused(frame, robots), weight) for robots, weight in in_time.items()]
    pairs = list(zip(parts, windows, strict=True))
    return Comparison(
        frames=len(compared),
        ap_70_live=precision_of(live),
        ap_70_played=precision_of(played),
        in_time_live=_ratio(
            sum(len(frame.participants) - 1 for frame in recorded.frames),
            sum(len(part.robots) * len(part.frames) for part in parts),
        ),
        in_time_played=_ratio(
            sum(len(one.in_time) for window in windows for one in window.fused()),
            sum(len(part.robots) * len(window.fused()) for part, window in pairs),
        ),
        fused_live=_ratio(len(recorded.frames), sum(part.due for part in parts)),
        fused_played=_ratio(
            sum(len(window.fused()) for window in windows),
            sum(len(window.frames) for window in windows),
        ),
        latency_ms_p50_played=float(
            np.median([1e3 * one.latency_s for window in windows for one in window.fused()])
        ),
    )


class _Player:
    """Plays and fuses the frames of one swarm."""

    def __init__(
        self, scenario: Scenario, link_bps: float, first: Detections, machine: Machine
    ) -> None:
        self._world = OnceWorld(scenario.open())
        self._ego = first.ego
        self._machine = machine
        self._fusion = cache(self._make_fusion)
        fusions: dict[str, Fusion] = {name: self._fusion(name) for name in ALGORITHMS}
        messages = heard(self._world, self._number(first), self._ego, fusions)
        control = control_bps(snapshot(self._ego, messages, link_bps))
        self._left_bps = left_bps(link_bps, control)

    def play(self, part: Stretch) -> Played:
        """Payloads are as large as in the stretch's first frame."""
        sizes = self._frame(part.frames[0], part.robots).bytes
        algorithm = part.frames[0].algorithm if part.robots else SINGLE
        conditions = Conditions(
            work=self._machine.compute.work(self._world.detector, algorithm),
            cell_bps=lambda _: self._left_bps,
            processors=self._machine.processors,
            period_s=part.step / self._world.rate_hz,
            deadline_s=part.deadline_s,
        )
        return play(part.robots, part.due, lambda robot, _: sizes[robot], conditions)

    def fused(self, frame: Detections, robots: tuple[str, ...]) -> Match:
        """The frame, fused with these robots."""
        return self._frame(frame, robots).matches[IOUS.index(IOU)]

    def published(self, frame: Detections) -> Match:
        """The frame as it was published."""
        boxes = boxes_of(frame)
        return match(*judge(self._world, self._number(frame), self._ego, boxes), IOU)

    def _frame(self, frame: Detections, robots: tuple[str, ...]) -> FusedFrame:
        fusion = self._fusion(frame.algorithm) if robots else SINGLE
        return fused_frame(self._world, self._number(frame), self._ego, robots, fusion, 0.0)

    def _number(self, frame: Detections) -> int:
        return frame.frame % self._world.frame_count

    def _make_fusion(self, name: str) -> RememberingFusion:
        return RememberingFusion(make_fusion(name, self._world.detector))


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else 1.0
