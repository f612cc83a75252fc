"""Intermediate fusion of the cells that matter, after Where2comm (Hu et al., NeurIPS 2022): a robot
sends the cells where it believes an object to be and where the ego asks."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perception.codec.envelope import inflate
from perception.detector.config import configuration
from perception.detector.learned import Detector
from perception.fusion.base import Fusion
from perception.fusion.detectors import shared_detector
from perception.fusion.feature_fusion import FeatureFusion
from perception.fusion.maps import attend, strongest

MIN_CHANCE = 0.02
AROUND = 2
"""Cells around an object's likely middle that are sent, too: its box shows in all of them."""
FADE = 0.6
"""How much less each step away from the middle counts."""
BLOCK = 8
"""Cells along one side of a block, for which the ego asks or does not."""
SURE = 0.9
"""A block where the ego's own view is this sure of an object, and nowhere in doubt, is not asked
for."""
DOUBT = 0.05


class IntermediateSparse(FeatureFusion):
    """The likeliest objects' cells."""

    max_cells = 600
    """Of one payload, so that it takes less than 8 kB."""

    name = "intermediate-sparse"
    asks = True

    def __init__(self, detector: Detector) -> None:
        super().__init__(detector)
        by = configuration(detector.config.name).fuses_cells_by
        self.fuse_maps = strongest if by == "strongest" else attend

    def select(self, chance: NDArray[np.float32], demand: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Those around the likeliest middles of those asked for, `max_cells` at most."""
        from scipy.ndimage import maximum_filter

        worth = chance
        for step in range(1, AROUND + 1):
            worth = np.maximum(worth, FADE**step * maximum_filter(chance, 2 * step + 1))
        wanted = np.where(demand, worth, 0.0).reshape(-1)
        best = np.argsort(-wanted, kind="stable")[: self.max_cells]
        chosen = np.zeros(wanted.shape, dtype=np.bool_)
        chosen[best[wanted[best] > MIN_CHANCE]] = True
        return chosen.reshape(chance.shape)

    def demand(self, own: Tensor) -> bytes:
        """A bit for each block."""
        return zlib.compress(np.packbits(self._unsure(own)).tobytes(), 9)

    def wanted(self, demand: bytes) -> NDArray[np.bool_]:
        """Bool (rows, columns); everything where nothing was said. Raises PayloadError."""
        rows, columns = self.detector.config.cells
        if not demand:
            return np.ones((rows, columns), dtype=np.bool_)
        down, across = -(-rows // BLOCK), -(-columns // BLOCK)
        raw = inflate(demand, -(-down * across // 8), "demand")
        bits = np.unpackbits(np.frombuffer(raw, np.uint8), count=down * across)
        blocks = bits.reshape(down, across).astype(np.bool_)
        return blocks.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[:rows, :columns]

    def _unsure(self, own: Tensor) -> NDArray[np.bool_]:
        """Bool (blocks down, blocks across)."""
        chance = self.detector.look(own)[0].numpy()
        rows, columns = chance.shape
        padded = np.pad(chance, ((0, -rows % BLOCK), (0, -columns % BLOCK)))
        blocks = padded.reshape(padded.shape[0] // BLOCK, BLOCK, -1, BLOCK).swapaxes(1, 2)
        peaks = blocks.reshape(*blocks.shape[:2], -1)
        between = ((peaks > DOUBT) & (peaks < SURE)).any(axis=2)
        unsure: NDArray[np.bool_] = between | (peaks.max(axis=2) < SURE)
        return unsure


def fusion(detector: str) -> Fusion:
    """The algorithm with a detector configuration. Raises PerceptionError without weights."""
    return IntermediateSparse(shared_detector(detector))
