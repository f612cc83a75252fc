"""Poses as an ego put them right when it fused a frame that is fused again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from perception.fusion.aligner import Known
from perception.fusion.alignment import Estimate, correction
from swarm.geometry import Matrix, invert


@dataclass(frozen=True, slots=True)
class Corrected:
    """Senders' poses are put right by what the ego put them right by, whatever it had seen before:
    see `perception.fusion.aligner.Remembering`."""

    moves: Mapping[str, tuple[float, float, float]] | None
    """x, y and turn in the world frame; of those that were moved. None: the frame
    speaks for itself."""
    world_from_own: Matrix = field(default_factory=lambda: np.eye(4))

    def at(self, time_s: float, stood_s: float, world_from_own: Matrix) -> Corrected:
        """See `Remembering.at`."""
        return replace(self, world_from_own=world_from_own)

    def corrected(self, robot: str, own_from_sender: Matrix, shown: Estimate) -> Known | None:
        """See `PoseMemory.corrected`."""
        if self.moves is None:
            return None
        if robot not in self.moves:
            return Known(np.eye(4), 0.0)
        stands = (self.world_from_own @ own_from_sender)[:2, 3]
        by = correction(np.array(self.moves[robot]), stands)
        return Known(invert(self.world_from_own) @ by @ self.world_from_own, 0.0)

    def usual_m(self) -> float:
        """See `PoseMemory.usual_m`."""
        # Whoever is recorded as a participant was believed.
        return 0.0
