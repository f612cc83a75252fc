"""Intermediate fusion of the cells that matter, as numbers of codebook entries (after CodeFilling,
Hu et al., CVPR 2024): a few bytes a cell."""

from __future__ import annotations

from perception.fusion.algorithms.intermediate_sparse import IntermediateSparse
from perception.fusion.base import Fusion
from perception.fusion.detectors import shared_detector


class IntermediateCodebook(IntermediateSparse):
    """The likeliest objects' cells, a byte for each part before compression."""

    name = "intermediate-codebook"
    max_cells = 900
    coded = True


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError without weights."""
    return IntermediateCodebook(shared_detector(detector))
