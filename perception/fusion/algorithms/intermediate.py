"""Intermediate fusion by attention over whole feature maps (AttFuse of OPV2V)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.fusion.base import Fusion
from perception.fusion.detectors import shared_detector
from perception.fusion.feature_fusion import FeatureFusion
from perception.fusion.maps import attend


class Intermediate(FeatureFusion):
    """Every cell of every map."""

    name = "intermediate"
    fuse_maps = staticmethod(attend)

    def select(self, chance: NDArray[np.float32], demand: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """All cells."""
        return np.ones_like(demand)


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError without weights."""
    return Intermediate(shared_detector(detector))
