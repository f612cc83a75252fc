"""The learned detector as perception uses it: points to feature maps, feature maps to boxes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perception.detector.backends import choose
from perception.detector.grid import BevConfig
from perception.detector.heads import read_boxes
from perception.detector.weights import load_weights
from perception.kernels.convolution import reached
from perception.types import Boxes, clean_points
from swarm.geometry import Matrix, Points, transform


class Detector:
    """A network with its weights; safe to use from several threads.

    Feature maps are float32 tensors (FEATURES, rows, columns) in 0 to 1 over the configuration's
    area around the frame of the points. Raises PerceptionError when the weights cannot be used.
    """

    def __init__(self, name: str, weights: Path | None = None, backend: str | None = None) -> None:
        """`backend`: what runs the network; see `perception.detector.backends.choose`."""
        loaded = load_weights(name, weights)
        self.config: BevConfig = loaded.config
        self.version = loaded.version
        self.codebook = loaded.codebook
        self._last: tuple[Points, Matrix, Tensor] | None = None
        self.backend = choose(loaded.network, self.config, backend)
        self._view = loaded.network.encoder.view

    def encode_in(self, points: Points, map_from_points: Matrix) -> Tensor:
        """The feature map of a cloud float32 (N, 3), 4 x 4 of whose frame is given in that of the
        map. The last one is kept: several algorithms send parts of the same map."""
        last = self._last
        if last is not None and last[0] is points and np.array_equal(last[1], map_from_points):
            return last[2]
        features = self.encode(transform(map_from_points, clean_points(points)))
        self._last = (points, map_from_points, features)
        return features

    def encode(self, points: Points) -> Tensor:
        """The feature map of a cloud float32 (N, 3) in the frame of the map."""
        return self.backend.encode(points)

    def look(self, features: Tensor) -> Tensor:
        """What a map shows by itself: float32 (3, rows, columns): the chance that an object's
        middle is in the cell, and its offset from the cell's middle along x and y, cells."""
        with torch.inference_mode():
            seen = self._view(features[None])[0]
            return torch.cat([seen[:1].sigmoid(), seen[1:]])

    def decode(self, fused: Tensor) -> Boxes:
        """The boxes that a feature map shows, best score first, in the frame of the map."""
        with torch.inference_mode():
            # Elsewhere nobody has said anything: no robot has a point near. In NumPy: PyTorch's
            # other threads go on spinning for a while, and those of the loops in C wait for them.
            said = reached((fused.numpy() != 0.0).any(axis=0))
            heat, channels = self.backend.decode(fused, torch.from_numpy(said))
            return read_boxes(self.config, heat, channels, said)

    def detect(self, points: Points) -> Boxes:
        """The boxes in a cloud float32 (N, 3), in its frame; points off the area are left out."""
        return self.decode(self.encode(points))
