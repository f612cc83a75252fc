"""Intermediate fusion: robots encode their points in the ego's frame and send cells of the feature
map; the ego fuses the maps cell by cell and decodes them.

Robots turn their points, not their features, into the ego's frame (as OpenCOOD does), so nothing is
resampled and a cell is a cell for everybody.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perception.codec.features import LEVELS, CellBlock, decode_cells, encode_cells
from perception.codec.outlined import add_outline
from perception.detector.codebook import from_codes, to_codes
from perception.detector.finders import Learned
from perception.detector.learned import Detector
from perception.detector.network import FEATURES
from perception.fusion.base import EncodeOptions
from perception.fusion.maps import SentMap
from perception.fusion.one_pass import MapForm
from perception.fusion.outline import outline, thinned
from perception.types import clean_points
from swarm.errors import PayloadError
from swarm.geometry import Points, Pose, invert

MAX_REFERENCE_OFF = 0.01
"""Metres and radians by which a payload's reference may differ from the ego's: float32 on the wire
a few kilometres from the world's origin."""

Fuse = Callable[[Tensor, Tensor], Tensor]


class FeatureFusion(MapForm):
    """What all intermediate algorithms have in common."""

    fuse_maps: Fuse
    coded = False
    """Whether cells travel as codebook entries."""

    def __init__(self, detector: Detector) -> None:
        self.detector = detector
        self.finder = Learned(detector.config.name, detector)

    @abstractmethod
    def select(self, chance: NDArray[np.float32], demand: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which cells are sent: bool (rows, columns).

        chance: float32 (rows, columns), how likely an object's middle is in each cell.
        demand: bool (rows, columns), where the ego wants to know more.
        """

    def wanted(self, demand: bytes) -> NDArray[np.bool_]:
        """The reverse of `demand`: bool (rows, columns). Raises PayloadError."""
        return np.ones(self.detector.config.cells, dtype=np.bool_)

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The cells that `select` picks; in the robot's own frame where none is asked for."""
        cloud = clean_points(points)
        own = options.pose or Pose(0.0, 0.0, 0.0)
        reference = options.reference or own
        matrix = invert(reference.matrix()) @ own.matrix()
        features = self.detector.encode_in(points, matrix)
        chance = self.detector.look(features)[0].numpy()
        present = self.select(chance, self.wanted(options.demand))
        cells = features.permute(1, 2, 0)[torch.from_numpy(present)].numpy()
        if self.coded:
            values = to_codes(self.detector.codebook, cells)
        else:
            values = np.rint(cells.T * LEVELS).astype(np.uint8)
        block = CellBlock(
            self.detector.version,
            self.detector.config.cells,
            reference.as_tuple(),
            present,
            values,
            self.coded,
            self.detector.backend.numerics,
        )
        return add_outline(encode_cells(block), thinned(outline(cloud)))

    def read(self, payload: bytes, reference: Pose) -> SentMap:
        """See `MapForm.read`."""
        shape, book = self.detector.config.cells, self.detector.codebook
        block = decode_cells(payload, self.detector.version, shape, FEATURES, len(book))
        if block.coded != self.coded:
            raise PayloadError(f"the feature map is not of the form that {self.name} sends")
        apart = np.abs(np.subtract(block.reference, reference.as_tuple()))
        apart[3:] = np.minimum(apart[3:] % (2 * np.pi), -apart[3:] % (2 * np.pi))
        if apart.max() > MAX_REFERENCE_OFF:
            raise PayloadError(f"the feature map lies around {block.reference}, not around the ego")
        if block.coded:
            cells = torch.from_numpy(from_codes(book, block.values))
        else:
            cells = torch.from_numpy(block.values.T.astype(np.float32) / LEVELS)
        present = torch.from_numpy(block.present)
        sent = torch.zeros(*shape, FEATURES)
        sent[present] = cells
        # A robot says nothing about cells without any feature: it has no point near.
        present &= sent.amax(dim=-1) > 0.0
        return SentMap(sent.permute(2, 0, 1), present)

    def join(self, own: Tensor, sent: Sequence[SentMap]) -> Tensor:
        """See `MapForm.join`."""
        everywhere = torch.ones(self.detector.config.cells, dtype=torch.bool)
        with torch.inference_mode():
            here = torch.stack([everywhere, *(one.present for one in sent)])
            return self.fuse_maps(_stacked([own, *(one.cells for one in sent)]), here)


def _stacked(maps: list[Tensor]) -> Tensor:
    """Maps (C, rows, columns) as (K, C, rows, columns), each with its channels side by side in
    memory, as compiled loops read them."""
    return torch.stack([one.permute(1, 2, 0) for one in maps]).permute(0, 3, 1, 2)
