"""The network: an encoder that every robot runs on its own points, and a decoder that the ego runs
on the fused feature map. One set of weights serves early, late and intermediate fusion: early and
late fusion run both on one map.

Feature maps are float32 (clouds, FEATURES, rows, columns) in 0 to 1.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from perception.detector.grid import PILLARS_OF_CELL, BevConfig
from perception.detector.maxima import largest_around
from perception.detector.pillars import POINT_FEATURES, Pillars

FEATURES = 32
"""Channels of a shared feature map."""
VIEW_CHANNELS = 3
"""Of a robot's own view: how likely an object's middle lies here, and its offset in cells."""
EVIDENCE = 3
"""Cells around a point about which its robot says something, since the middle of a large object is
hollow. Everywhere else features are 0."""
BOX_CHANNELS = 9
"""x, y offset in cells; z; log length, width, height; cos and sin of the turned heading; IoU."""


class Encoder(nn.Module):
    """Points of one robot to its feature map, with a first view of where objects are."""

    def __init__(self, config: BevConfig) -> None:
        super().__init__()
        self._cells = config.cells
        self.points = nn.Sequential(
            nn.Linear(POINT_FEATURES, 32, bias=False), nn.BatchNorm1d(32), nn.ReLU()
        )
        self.down = _conv(32 * PILLARS_OF_CELL, 32, kernel=1)
        self.near = _Residual(32)
        self.wide_down = _conv(32, 64, stride=2)
        self.wide = _Residual(64)
        self.wide_up = _conv(64, 32, kernel=1)
        self.merge = _conv(32, 32)
        self.shared = nn.Sequential(
            nn.Conv2d(32, FEATURES, 1, bias=False), nn.BatchNorm2d(FEATURES)
        )
        self.view = nn.Conv2d(FEATURES, VIEW_CHANNELS, 1)
        _start_rare(self.view, 1)

    def forward(self, pillars: Pillars) -> Tensor:
        """The feature maps of the pillars' clouds."""
        encoded = self.points(pillars.features)
        hit = self._hit(pillars)
        if self.training:
            image = self._dense(encoded, pillars)
        else:
            image = self._sparse(encoded, pillars, hit)
        near = self.near(image)
        wide = self.wide_up(self.wide(self.wide_down(near)))
        wide = functional.interpolate(wide, size=near.shape[2:], mode="nearest")
        features: Tensor = self.shared(self.merge(near + wide))
        return features.clamp(0.0, 1.0) * largest_around(hit, EVIDENCE)

    def _dense(self, encoded: Tensor, pillars: Pillars) -> Tensor:
        """Cells from their pillars' largest values: (clouds, channels, rows, columns)."""
        rows, columns = self._cells
        count = pillars.clouds * rows * columns * PILLARS_OF_CELL
        canvas = _pillar_maxima(encoded, pillars.index, count)
        image: Tensor = self.down(_image(canvas, pillars.clouds, self._cells))
        return image

    def _sparse(self, encoded: Tensor, pillars: Pillars, hit: Tensor) -> Tensor:
        """The same, computed where there are points: a quarter of the cells, or fewer. Not for
        training, whose batch norms count all cells."""
        filled = hit.flatten() > 0.0
        # Each cell's place among those with points; the first place is that of all without.
        place = filled.cumsum(0) * filled
        cell, which = pillars.index // PILLARS_OF_CELL, pillars.index % PILLARS_OF_CELL
        known = 1 + int(filled.sum())
        canvas = _pillar_maxima(
            encoded, place[cell] * PILLARS_OF_CELL + which, known * PILLARS_OF_CELL
        )
        told = self.down(_image(canvas, 1, (known, 1))).permute(0, 2, 3, 1).flatten(0, 2)
        return _image(told[place], pillars.clouds, self._cells)

    def _hit(self, pillars: Pillars) -> Tensor:
        """1 where a point is in the cell, else 0: (clouds, 1, rows, columns)."""
        rows, columns = self._cells
        hit = torch.zeros(pillars.clouds * rows * columns, device=pillars.features.device)
        hit[pillars.index // PILLARS_OF_CELL] = 1.0
        return hit.view(pillars.clouds, 1, rows, columns)

    def look(self, features: Tensor) -> Tensor:
        """What feature maps show by themselves: (clouds, VIEW_CHANNELS, rows, columns); the first
        channel is a logit."""
        seen: Tensor = self.view(features)
        return seen


class Decoder(nn.Module):
    """A fused feature map to heatmaps and boxes."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.enter = _conv(FEATURES, 48)
        self.near = _conv(48, 48)
        self.down = _conv(48, 96, stride=2)
        self.wide = nn.Sequential(_Residual(96), _Residual(96))
        self.up = _conv(96, 48, kernel=1)
        self.merge = nn.Sequential(_conv(96, 48), _conv(48, 64))
        self.heat = nn.Conv2d(64, classes, 1)
        self.boxes = nn.Conv2d(64, BOX_CHANNELS, 1)
        _start_rare(self.heat, classes)

    def forward(self, fused: Tensor) -> tuple[Tensor, Tensor]:
        """Heat logits (maps, classes, rows, columns) and box channels (maps, BOX_CHANNELS, ...)."""
        near = self.near(self.enter(fused))
        wide = self.up(self.wide(self.down(near)))
        wide = functional.interpolate(wide, size=near.shape[2:], mode="nearest")
        merged = self.merge(torch.cat([near, wide], dim=1))
        return self.heat(merged), self.boxes(merged)


def _start_rare(last: nn.Conv2d, channels: int) -> None:
    """Chances start at 1 in 100: few cells hold an object (Lin et al., focal loss, ICCV 2017)."""
    assert last.bias is not None
    nn.init.constant_(last.bias[:channels], -4.6)


class Network(nn.Module):
    """Encoder and decoder of one configuration."""

    def __init__(self, config: BevConfig) -> None:
        super().__init__()
        self.encoder = Encoder(config)
        self.decoder = Decoder(len(config.labels))


class _PillarMaxima(torch.autograd.Function):
    """Maximum of each pillar's points. PyTorch's own gradient of `scatter_reduce` makes a dozen
    passes over all pillars and took two fifths of a training step; this takes two over the points.
    """

    @staticmethod
    def forward(ctx: Any, encoded: Tensor, index: Tensor, pillars: int) -> Tensor:
        maxima = _scatter_max(encoded, index, pillars)
        ctx.save_for_backward(index, encoded == maxima[index])
        return maxima

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        index, largest = ctx.saved_tensors
        return gradients[0][index] * largest, None, None


def _image(values: Tensor, clouds: int, cells: tuple[int, int]) -> Tensor:
    """Values (clouds * rows * columns * n, C) as (clouds, n * C, rows, columns)."""
    return values.view(clouds, *cells, -1).permute(0, 3, 1, 2)


def _pillar_maxima(encoded: Tensor, index: Tensor, pillars: int) -> Tensor:
    if not torch.is_grad_enabled():
        return _scatter_max(encoded, index, pillars)
    maxima: Tensor = _PillarMaxima.apply(encoded, index, pillars)  # type: ignore[no-untyped-call]
    return maxima


def _scatter_max(encoded: Tensor, index: Tensor, pillars: int) -> Tensor:
    """float32 (pillars, C) from values (M, C) that are not negative; empty pillars are 0."""
    rows = index[:, None].expand(-1, encoded.shape[1])
    return encoded.new_zeros(pillars, encoded.shape[1]).scatter_reduce_(0, rows, encoded, "amax")


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = _conv(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, padding=1, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, image: Tensor) -> Tensor:
        return functional.relu(image + self.second(self.first(image)))


def _conv(before: int, after: int, *, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, after, kernel, stride, padding=kernel // 2, bias=False),
        nn.BatchNorm2d(after),
        nn.ReLU(),
    )
