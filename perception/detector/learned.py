"""The learned detector as perception uses it: points to feature maps, feature maps to boxes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval, fuse_linear_bn_eval

from perception.detector.grid import BevConfig
from perception.detector.heads import read_boxes
from perception.detector.maxima import largest_around
from perception.detector.pillars import pillarise
from perception.detector.weights import load_weights
from perception.types import Boxes, clean_points
from swarm.geometry import Matrix, Points, transform


class Detector:
    """A network with its weights; safe to use from several threads.

    Feature maps are float32 tensors (FEATURES, rows, columns) in 0 to 1 over the configuration's
    area around the frame of the points. Raises PerceptionError when the weights cannot be used.
    """

    def __init__(self, name: str, weights: Path | None = None) -> None:
        loaded = load_weights(name, weights)
        self.config: BevConfig = loaded.config
        self.version = loaded.version
        self.codebook = loaded.codebook
        self._last: tuple[Points, Matrix, Tensor] | None = None
        for module in list(loaded.network.modules()):
            _fold_norms(module)
        self._encoder = loaded.network.encoder.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._decoder = loaded.network.decoder.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

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
        with torch.inference_mode():
            # torch refuses arrays that cannot be written to, as scans are.
            cloud = torch.from_numpy(np.array(points, dtype=np.float32))
            features: Tensor = self._encoder(pillarise([cloud], self.config))[0]
            return features

    def look(self, features: Tensor) -> Tensor:
        """What a map shows by itself: float32 (3, rows, columns): the chance that an object's
        middle is in the cell, and its offset from the cell's middle along x and y, cells."""
        with torch.inference_mode():
            seen = self._encoder.look(features[None])[0]
            return torch.cat([seen[:1].sigmoid(), seen[1:]])

    def decode(self, fused: Tensor) -> Boxes:
        """The boxes that a feature map shows, best score first, in the frame of the map."""
        with torch.inference_mode():
            one = fused[None].contiguous(memory_format=torch.channels_last)
            heat, channels = self._decoder(one)
            # Nobody has said anything there: no robot has a point near.
            silent = largest_around(one.amax(dim=1), 1) == 0.0
            return read_boxes(self.config, heat[0].masked_fill(silent, -math.inf), channels[0])

    def detect(self, points: Points) -> Boxes:
        """The boxes in a cloud float32 (N, 3), in its frame; points off the area are left out."""
        return self.decode(self.encode(points))


def _fold_norms(module: nn.Module) -> None:
    """Puts batch norms into the layers before them: the same result in half of the passes."""
    if not isinstance(module, nn.Sequential):
        return
    for i in range(len(module) - 1):
        layer, norm = module[i], module[i + 1]
        if isinstance(layer, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
            module[i], module[i + 1] = fuse_conv_bn_eval(layer, norm), nn.Identity()
        elif isinstance(layer, nn.Linear) and isinstance(norm, nn.BatchNorm1d):
            module[i], module[i + 1] = fuse_linear_bn_eval(layer, norm), nn.Identity()
