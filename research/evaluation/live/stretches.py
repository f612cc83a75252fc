"""The frames that an ego published, by what it had decided."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

from ego_agent.knowledge.pace import USUAL, algorithm_of, in_turn, rate_of
from research.evaluation.live.swarm import Recorded
from swarm.messages import MIXED, Assignment, Decision, Detections


@dataclass(frozen=True, slots=True)
class Stretch:
    """Consecutive published frames of one decision."""

    frames: tuple[Detections, ...]
    assignments: tuple[Assignment, ...]
    """What everyone who was to take part sends and how often, apart from the ego."""
    deadline_s: float
    rate_hz: float
    """Fused frames a second."""
    sensor_hz: float

    @property
    def robots(self) -> tuple[str, ...]:
        """Who was to take part, apart from the ego."""
        return tuple(one.robot for one in self.assignments)

    def asked(self, frame: int) -> dict[str, str]:
        """Who is due in that frame of the sensors, and with what."""
        rates = {one.robot: one.rate_hz for one in self.assignments}
        turn = in_turn(rates, self.rate_hz, frame // self._stride)
        return {one.robot: one.algorithm for one in self.assignments if one.robot in turn}

    @property
    def _stride(self) -> int:
        return max(1, round(self.sensor_hz / self.rate_hz))

    @property
    def step(self) -> int:
        """Sensor frames from one frame that is asked for to the next, at the decision's rate."""
        if any(one.rate_hz < self.rate_hz for one in self.assignments):
            # An ego that skips every other frame would seem to ask half of the robots never.
            return self._stride
        numbers = [frame.frame for frame in self.frames]
        return min((b - a for a, b in pairwise(numbers) if b > a), default=1)

    @property
    def due(self) -> int:
        """Frames that could have been asked for from the first to the last."""
        return 1 + (self.frames[-1].frame - self.frames[0].frame) // self.step


def stretches(recorded: Recorded, sensor_hz: float) -> list[Stretch]:
    """The published frames by decision; one that was not heard is told by its frames.

    Frames that do not tell what robots were asked for are left out: those of several forms in which
    a robot is missing, where the decision was not heard.
    """
    decided = {decision.cycle: decision for decision in recorded.decisions}
    found: list[Stretch] = []
    last: tuple[object, ...] = ()
    for frame in recorded.frames:
        decision = decided.get(frame.cycle)
        assignments = _assignments(frame, decision)
        if any(one.algorithm == MIXED for one in assignments):
            continue
        deadline_s = (decision and decision.deadline_s) or USUAL.deadline_s
        rate_hz = decision.rate_hz if decision else USUAL.rate_hz
        key = (assignments, deadline_s, rate_hz)
        if found and key == last:
            found[-1] = replace(found[-1], frames=(*found[-1].frames, frame))
        else:
            found.append(Stretch((frame,), assignments, deadline_s, rate_hz, sensor_hz))
        last = key
    return found


def _assignments(frame: Detections, decision: Decision | None) -> tuple[Assignment, ...]:
    """Of the decision, or of those who were asked for the frame: MIXED where it does not tell for
    what."""
    if decision is None:
        robots = sorted({*frame.participants, *frame.missing} - {frame.ego})
        forms = {robot: frame.forms.get(robot, frame.algorithm) for robot in robots}
        rates = dict.fromkeys(robots, USUAL.rate_hz)
    else:
        robots = sorted({*decision.participants} - {frame.ego})
        forms = {robot: algorithm_of(decision, robot) for robot in robots}
        rates = {robot: rate_of(decision, robot) for robot in robots}
    return tuple(
        Assignment(robot=robot, algorithm=forms[robot], rate_hz=rates[robot]) for robot in robots
    )
