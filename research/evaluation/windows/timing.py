"""What a window is played with, and what comes of its frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ego_agent.execute.frame_round import MissingKind
from ego_agent.knowledge.compute import ComputeModel, Work
from ego_agent.knowledge.pace import USUAL
from research.evaluation.windows.cell import Rate


@dataclass(frozen=True, slots=True)
class Timing:
    """How fast machines are, and what else the ego's cell carries."""

    compute: ComputeModel
    control_bps: float = 0.0
    """What beacons and scene descriptions take of the cell."""
    processors: int | None = None
    """That all robots and the ego share; None: each has one of its own."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a choice is played with."""

    work: Work
    """Of everyone; where it is said who is `asked`, the ego's own, and that of single answers
    stands there."""
    cell_bps: Rate
    """What observations have of the ego's cell, by seconds since the window began."""
    own_bps: Mapping[str, float] = field(default_factory=dict)
    """Of robots with a link of their own that may be narrower."""
    processors: int | None = None
    """That the robots and the ego share; None: each has one of its own."""
    period_s: float = 1.0 / USUAL.rate_hz
    deadline_s: float = USUAL.deadline_s
    asked: Sequence[Mapping[str, Work]] | None = None
    """By frame: who is asked, and what the answer takes of the robot and adds to the ego's work;
    None: everyone is, in each."""


@dataclass(frozen=True, slots=True)
class PlayedFrame:
    """One frame that was fused."""

    number: int
    in_time: tuple[str, ...]
    missing: Mapping[str, MissingKind]
    """Why the other participants are not in it."""
    latency_s: float
    """From the first query to the fused boxes."""


@dataclass(frozen=True, slots=True)
class Played:
    """A window's frames."""

    frames: tuple[PlayedFrame | None, ...]
    """By number; None for one that was skipped."""
    sent_bytes: int
    """Of all answers that the cell carried, in time or not."""

    def fused(self) -> list[PlayedFrame]:
        """The frames that were not skipped; the first always is one."""
        return [frame for frame in self.frames if frame is not None]

    def shown_from(self, number: int) -> PlayedFrame:
        """The first fused frame that is not before that one, else the last."""
        fused = self.fused()
        return next((frame for frame in fused if frame.number >= number), fused[-1])
