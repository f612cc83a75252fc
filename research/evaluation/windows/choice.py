"""Choices, and what they brought."""

from __future__ import annotations

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
class Outcome:
    """What a choice brought over the sampled frames of a window."""

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

    def value(self, objective: Objective) -> float:
        """AP@0.7 - lambda C: the objective with measured precision as Q."""
        return objective.value(self.ap_70, round(self.bytes_per_frame))

    def half_value(self, objective: Objective, half: int) -> float:
        """The same on one half of the frames; 0 where there are no halves."""
        if self.halves is None:
            return 0.0
        return objective.value(self.halves[half], round(self.bytes_per_frame))

    def overruns(self, objective: Objective, capacity_bps: float) -> bool:
        """Whether it needs more than all of the link."""
        return self.bytes_per_frame * 8 * objective.rate_hz > capacity_bps
