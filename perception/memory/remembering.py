"""From what was fused in a frame to what is remembered, by the rules of what is published."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from perception.fusion.base import Fusion
from perception.fusion.known import KnownRobot, shows_known
from perception.fusion.publishing import chances, operating_point, scored_as
from perception.memory.memory import Frame, Memory, Remembered
from perception.memory.reprocessing import ReprocessingMemory

OWN_BOXES = "late"
"""The algorithm for which each robot finds boxes by itself."""


def remember(
    memory: Memory | ReprocessingMemory,
    frame: Frame,
    detector: str,
    algorithm: str | Fusion,
    known: Sequence[KnownRobot],
) -> Remembered | None:
    """What is there by all that was found until now: tracks from the operating point on that show
    no known robot. None where nobody has calibrated the algorithm, whose scores are no chances.

    `frame.boxes` as the algorithm has fused them, with raw scores. Raises PerceptionError as
    `perception.fusion.publishing.publish` does.
    """
    least = operating_point(detector, algorithm)
    found = chances(frame.boxes, detector, algorithm, len(frame.helpers), known)
    if found is None or least is None:
        return None
    completes = scored_as(algorithm) != OWN_BOXES
    told = memory.update(replace(frame, boxes=found, completes=completes))
    kept = (told.boxes.scores >= least) & ~shows_known(told.boxes, known)
    return told.take(np.flatnonzero(kept))


def suspected(memory: Memory | ReprocessingMemory, known: Sequence[KnownRobot]) -> Remembered:
    """All that may be there at the newest frame, told or not, without known robots."""
    tracks = memory.suspected()
    return tracks.take(np.flatnonzero(~shows_known(tracks.boxes, known)))
