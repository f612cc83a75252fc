"""Intermediate fusion by the strongest feature (F-Cooper), over whole feature maps."""

from __future__ import annotations

from perception.fusion.algorithms.intermediate import Intermediate
from perception.fusion.base import Fusion
from perception.fusion.detectors import shared_detector
from perception.fusion.maps import strongest


class IntermediateMax(Intermediate):
    """Every cell of every map."""

    name = "intermediate-max"
    fuse_maps = staticmethod(strongest)


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError without weights."""
    return IntermediateMax(shared_detector(detector))
