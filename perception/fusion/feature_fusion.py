"""Intermediate fusion: robots encode their points in the ego's frame and send cells of the feature
map; the ego fuses the maps cell by cell and decodes them.

Robots turn their points, not their features, into the ego's frame (as OpenCOOD does), so nothing is
resampled and a cell is a cell for everybody.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perception.codec.features import LEVELS, CellBlock, decode_cells, encode_cells
from perception.codec.outlined import add_outline, take_outline
from perception.detector.codebook import from_codes, to_codes
from perception.detector.config import configuration
from perception.detector.learned import Detector
from perception.detector.network import FEATURES
from perception.fusion.aligner import Aligner, in_world
from perception.fusion.base import (
    Ask,
    Contribution,
    EncodeOptions,
    Fusion,
    Gathering,
)
from perception.fusion.known import without_own
from perception.fusion.maps import moved
from perception.fusion.outline import outline, thinned
from perception.types import Boxes, clean_points
from swarm.errors import PayloadError
from swarm.geometry import Matrix, Points, Pose, invert, pose_of

MAX_REFERENCE_OFF = 0.01
"""Metres and radians by which a payload's reference may differ from the ego's: float32 on the wire
a few kilometres from the world's origin."""

Fuse = Callable[[Tensor, Tensor], Tensor]


class FeatureFusion(Fusion):
    """What all intermediate algorithms have in common."""

    fuse_maps: Fuse
    coded = False
    """Whether cells travel as codebook entries."""
    asks = False
    """Whether the ego tells robots what it wants to know."""

    def __init__(self, detector: Detector) -> None:
        self.detector = detector

    @abstractmethod
    def select(self, chance: NDArray[np.float32], demand: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which cells are sent: bool (rows, columns).

        chance: float32 (rows, columns), how likely an object's middle is in each cell.
        demand: bool (rows, columns), where the ego wants to know more.
        """

    def demand(self, own: Tensor) -> bytes:
        """What the ego asks for, from its own map; empty: everything."""
        return b""

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

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts with the own map."""
        return _Maps(self, own, world_from_own)


class _Maps(Gathering):
    """Feature maps in the ego's frame."""

    def __init__(self, fusion: FeatureFusion, own: Points, world_from_own: Matrix) -> None:
        self._fusion = fusion
        self._detector = fusion.detector
        self._world_from_own = world_from_own
        self._reference = pose_of(world_from_own)
        self._points = own
        self._aligner = Aligner(own) if fusion.corrects else None
        self._own_map: Tensor | None = None
        self._maps: list[Tensor] = []
        self._present: list[Tensor] = []
        self._robots: list[str] = []
        self._own_body_m = configuration(self._detector.config.name).own_body_m

    def ask(self) -> Ask:
        return Ask(self._reference, self._fusion.demand(self._own) if self._fusion.asks else b"")

    def prepare(self) -> None:
        _ = self._own
        if self._aligner is not None:
            self._aligner.prepare()

    @property
    def _own(self) -> Tensor:
        if self._own_map is None:
            self._own_map = self._detector.encode(clean_points(self._points))
        return self._own_map

    def add(self, contribution: Contribution) -> None:
        shape = self._detector.config.cells
        book = self._detector.codebook
        payload, places = take_outline(contribution.payload)
        block = decode_cells(payload, self._detector.version, shape, FEATURES, len(book))
        if block.coded != self._fusion.coded:
            raise PayloadError(f"the feature map is not of the form that {self._fusion.name} sends")
        apart = np.abs(np.subtract(block.reference, self._reference.as_tuple()))
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
        own_from_sender = invert(self._world_from_own) @ contribution.world_from_sensor
        if self._aligner is not None:
            self._aligner.add(places, own_from_sender)
        self._maps.append(sent.permute(2, 0, 1))
        self._present.append(present)
        self._robots.append(contribution.robot)

    def finish(self) -> Boxes:
        fused = self._own
        if self._maps:
            everywhere = torch.ones(self._detector.config.cells, dtype=torch.bool)
            with torch.inference_mode():
                maps, present = self._corrected()
                here = torch.stack([everywhere, *present])
                fused = self._fusion.fuse_maps(_stacked([fused, *maps]), here)
        found = without_own(self._detector.decode(fused), self._own_body_m, self.stood_at)
        return found.transformed(self._world_from_own)

    def corrections(self) -> dict[str, Matrix]:
        return in_world(self._aligner, self._robots, self._world_from_own)

    def _corrected(self) -> tuple[list[Tensor], list[Tensor]]:
        """The maps and which of their cells are present, moved where poses are corrected."""
        maps, present = list(self._maps), list(self._present)
        config = self._detector.config
        half = (config.half_x_m, config.half_y_m)
        for i, by in enumerate(self._aligner.corrections() if self._aligner else ()):
            if not np.array_equal(by, np.eye(4)):
                maps[i], present[i] = moved(maps[i], present[i], half, by)
        return maps, present


def _stacked(maps: list[Tensor]) -> Tensor:
    """Maps (C, rows, columns) as (K, C, rows, columns), each with its channels side by side in
    memory, as compiled loops read them."""
    return torch.stack([one.permute(1, 2, 0) for one in maps]).permute(0, 3, 1, 2)
