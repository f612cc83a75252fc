"""Which detector recorded data gets that names none."""

from __future__ import annotations

from collections.abc import Sequence

from perception.detector.suits import best_detector, profile
from swarm.geometry import Points

DEFAULT = "factory"
"""Where the scans do not tell."""
LOOKED_AT = 3
"""Scans of each robot by which one is chosen: the first ones, so that all processes choose the same
one while data grows."""


def choose_detector(scans: Sequence[Points]) -> tuple[str, tuple[str, ...]]:
    """The name of the detector that suits scans (N, 3) best, and why."""
    seen = profile(scans)
    if seen is None:
        return DEFAULT, ()
    name = best_detector(seen)
    return name, (f"detector {name} is taken by what the scans are like: {seen}",)
