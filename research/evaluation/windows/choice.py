"""Choices, and what they brought."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ego_agent.knowledge.objective import Objective

ALONE = ""
"""The algorithm of an ego without participants: it does not matter."""


@dataclass(frozen=True, slots=True, order=True)
class Choice:
    """Who takes part, apart from the ego, and with which algorithm."""

    participants: tuple[str, ...]
    """Sorted."""
    algorithm: str

    @classmethod
    def of(cls, participants: Iterable[str], algorithm: str, ego: str) -> Choice:
        """The choice of these participants, with or without the ego."""
        others = tuple(sorted(set(participants) - {ego}))
        return cls(others, algorithm if others else ALONE)


@dataclass(frozen=True, slots=True)
class Delivered:
    """What came in time of a choice when its window was played."""

    ap_70: float
    halves: tuple[float, float] | None
    """As those of the outcome."""
    bytes_per_frame: float
    """That the link carried, in time or not, for each frame of the window."""
    ego_ms_per_frame: float
    """The ego's work for a fused frame, by the model of compute."""
    helping_ms_per_frame: float
    """What of that is for contributions, and the participants' work."""
    capacity_bps: float
    """Mean of C(t) over the window."""
    in_time_ratio: float
    """Contributions in time, of those that the fused frames could have had; 1 without any."""
    fused_ratio: float
    """Frames fused, of those of the window."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a choice brought over the sampled frames of a window, had all of it come at once."""

    ap_30: float
    ap_50: float
    ap_70: float
    bytes_per_frame: float
    """Requests and payloads of all participants."""
    frames: int
    ground_truth: int
    """True boxes that count in all frames together."""
    halves: tuple[float, float] | None
    """AP@0.7 of every other frame from the first, and of the rest; None unless both hold true
    boxes."""
    ap_70_with_known: float = 0.0
    """Of the robots of which beacons tell, too."""
    delivered: Delivered | None = None
    """What came in time; None where no time was played."""

    @property
    def arrived(self) -> Delivered:
        """What came in time: everything where no time was played."""
        return self.delivered or Delivered(
            self.ap_70, self.halves, self.bytes_per_frame, 0.0, 0.0, math.inf, 1.0, 1.0
        )

    def value(self, objective: Objective) -> float:
        """AP@0.7 - lambda C of what came in time: the objective with measured precision as Q."""
        return self._value(objective, self.arrived.ap_70)

    def half_value(self, objective: Objective, half: int) -> float:
        """The same on one half of the frames; 0 where there are no halves."""
        halves = self.arrived.halves
        return 0.0 if halves is None else self._value(objective, halves[half])

    def overruns(self, objective: Objective, capacity_bps: float) -> bool:
        """Whether it needs more than all of the link."""
        return self.bytes_per_frame * 8 * objective.rate_hz > capacity_bps

    def _value(self, objective: Objective, ap_70: float) -> float:
        came = self.arrived
        work_s = came.helping_ms_per_frame * 1e-3
        rate_hz = objective.rate_hz
        return ap_70 - objective.cost(came.bytes_per_frame, came.capacity_bps, work_s, rate_hz)
