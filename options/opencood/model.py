"""An OpenCOOD model from its directory: scans in, boxes out, for one vehicle or several."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

import torch
from torch import Tensor

from options.opencood.anchors import best, decode
from options.opencood.checkpoint import find_checkpoint, load_into
from options.opencood.clouds import mirrored, network_cloud
from options.opencood.config import OpenCoodConfig, read_config
from options.opencood.network import PointPillarNetwork
from options.opencood.pillars import Pillars, sort_into_pillars
from perception.types import Boxes
from swarm.geometry import Matrix, Points

Scan = tuple[Points, Matrix | None]
"""Points (N, 3) in their sensor's frame, and the transform from there to the frame of detection
(None: that is the sensor's own)."""


class OpenCoodModel:
    """Weights with their configuration. All frames are right-handed; none of it keeps state."""

    def __init__(self, config: OpenCoodConfig, network: PointPillarNetwork) -> None:
        self.config = config
        self.network = network.eval()
        self.version = _fingerprint(network)
        """CRC-32 of the weights: maps of other weights mean nothing here."""

    def detect(self, scans: Sequence[Scan]) -> Boxes:
        """Vehicles in the merged cloud of all scans, in the frame of detection.

        One scan gives what a vehicle sees alone; several are early fusion. Raises ScanError when
        points are not (N, 3).
        """
        pillars = self._pillars(scans)
        if not len(pillars.cells):
            return Boxes.empty()
        with torch.inference_mode():
            return self._boxes(*self.network.heads([self.network.encode(pillars)]))

    def encode(self, points: Points, ego_from_sensor: Matrix | None = None) -> Tensor:
        """A vehicle's map in the ego's frame, float32 (C, H, W), compressed if the model does.

        Raises ScanError when points are not (N, 3).
        """
        with torch.inference_mode():
            return self.network.encode(self._pillars([(points, ego_from_sensor)]))[0]

    def map_shape(self) -> tuple[int, int, int]:
        """Channels, rows and columns of what `encode` gives."""
        backbone, (nx, ny) = self.config.backbone, self.config.grid
        smaller = 2**backbone.compression
        scale = backbone.strides[0] * smaller
        return backbone.filters[0] // smaller, ny // scale, nx // scale

    def fuse(self, maps: Sequence[Tensor]) -> Boxes:
        """Vehicles from the maps (C, H, W) of several vehicles, the ego's own first, in the ego's
        frame."""
        with torch.inference_mode():
            return self._boxes(*self.network.heads([one[None] for one in maps]))

    def best(self, boxes: Boxes) -> Boxes:
        """Boxes in the ego's frame, filtered and without duplicates, as for a single vehicle."""
        return best(boxes, self.config.nms_threshold)

    def _pillars(self, scans: Iterable[Scan]) -> Pillars:
        chunks = chain.from_iterable(network_cloud(*scan) for scan in scans)
        return sort_into_pillars(chunks, self.config)

    def _boxes(self, logits: Tensor, offsets: Tensor) -> Boxes:
        return self.best(mirrored(decode(logits.numpy(), offsets.numpy(), self.config)))


def load(directory: Path, epoch: int | None = None) -> OpenCoodModel:
    """The model of an OpenCOOD directory: its `config.yaml` and a checkpoint (`find_checkpoint`).

    Raises PerceptionError when a file is missing, damaged, unsafe, or does not fit the other.
    """
    config = read_config(Path(directory))
    network = PointPillarNetwork(config)
    load_into(network, find_checkpoint(Path(directory), epoch))
    return OpenCoodModel(config, network)


def _fingerprint(network: PointPillarNetwork) -> int:
    crc = 0
    for name, value in network.state_dict().items():
        crc = zlib.crc32(value.contiguous().numpy().tobytes(), zlib.crc32(name.encode(), crc))
    return crc
