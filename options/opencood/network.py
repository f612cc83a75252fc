"""The networks behind OpenCOOD's `point_pillar` and `point_pillar_intermediate`.

PointPillars (Lang et al., CVPR 2019): a small network turns each pillar into a vector, a
convolutional pyramid turns the map of vectors into scores and box offsets for every anchor. With
several vehicles, AttFuse (Xu et al., OPV2V, ICRA 2022) weighs their maps cell by cell, at every
level of the pyramid. Names of submodules are those of the published state dicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from options.opencood.config import BackboneConfig, OpenCoodConfig
from options.opencood.pillars import Pillars

_NORM_EPSILON = 1e-3
_POINT_FEATURES = 10
"""x, y, z, intensity; x, y, z from the mean of the pillar's points; and from its middle."""
_POINTS_AT_ONCE = 200_000


def _normed(layer: nn.Module, channels: int) -> list[nn.Module]:
    return [layer, nn.BatchNorm2d(channels, eps=_NORM_EPSILON), nn.ReLU()]


def _halving(inputs: int, outputs: int, stride: int) -> list[nn.Module]:
    """A 3 x 3 convolution with stride; padding is a layer of its own in the state dict's count."""
    layer = nn.Conv2d(inputs, outputs, 3, stride=stride, bias=False)
    return [nn.ZeroPad2d(1), *_normed(layer, outputs)]


def _same(inputs: int, outputs: int) -> list[nn.Module]:
    return _normed(nn.Conv2d(inputs, outputs, 3, padding=1, bias=False), outputs)


def _growing(inputs: int, outputs: int, factor: int) -> list[nn.Module]:
    layer = nn.ConvTranspose2d(inputs, outputs, factor, stride=factor, bias=False)
    return _normed(layer, outputs)


class _PointNet(nn.Module):
    """Linear, batch norm, ReLU for points; the largest of each channel for their pillar."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(_POINT_FEATURES, channels, bias=False)
        self.norm = nn.BatchNorm1d(channels, eps=_NORM_EPSILON)

    def activate(self, features: Tensor) -> Tensor:
        """(n, 10) to (n, channels)."""
        activated: Tensor = self.norm(self.linear(features)).relu()
        return activated


class _PillarEncoder(nn.Module):
    def __init__(self, config: OpenCoodConfig) -> None:
        super().__init__()
        self.pfn_layers = nn.ModuleList([_PointNet(config.pillar_channels)])
        self._config = config

    def forward(self, pillars: Pillars) -> Tensor:
        """The map of pillar vectors, float32 (1, channels, rows, columns); zero where none is."""
        (net,) = self.pfn_layers
        assert isinstance(net, _PointNet)
        config = self._config
        nx, ny = config.grid
        points, owner = torch.from_numpy(pillars.points), torch.from_numpy(pillars.pillar)
        cells = torch.from_numpy(pillars.cells)
        count = torch.bincount(owner, minlength=len(cells))
        means = torch.zeros(len(cells), 3).index_add_(0, owner, points[:, :3]) / count[:, None]
        size, low = torch.tensor(config.voxel_size), torch.tensor(config.lidar_range[:3])
        middles = nn.functional.pad(cells, (0, 1)) * size + (size / 2 + low)
        # A pillar that is not full is padded with zeros, which take part in the maximum.
        nothing = net.activate(torch.zeros(1, _POINT_FEATURES))
        vectors = torch.where((count < config.max_points)[:, None], nothing, -torch.inf)
        for start in range(0, len(points), _POINTS_AT_ONCE):
            part = slice(start, start + _POINTS_AT_ONCE)
            xyz, whose = points[part, :3], owner[part]
            features = torch.cat([points[part], xyz - means[whose], xyz - middles[whose]], dim=1)
            index = whose[:, None].expand(-1, vectors.shape[1])
            vectors.scatter_reduce_(0, index, net.activate(features), "amax")
        canvas = torch.zeros(config.pillar_channels, ny * nx)
        canvas[:, cells[:, 1] * nx + cells[:, 0]] = vectors.T
        return canvas.view(1, -1, ny, nx)


class _Compressor(nn.Module):
    """Halves a map `times` times, in size and in channels, and doubles it again."""

    def __init__(self, channels: int, times: int) -> None:
        super().__init__()
        widths = [channels // 2**i for i in range(times + 1)]
        steps = list(pairwise(widths))
        self.encoder = nn.ModuleList(
            nn.Sequential(*_halving(wide, wide, 2), *_same(wide, narrow)) for wide, narrow in steps
        )
        self.decoder = nn.ModuleList(
            nn.Sequential(
                nn.Sequential(*_growing(narrow, wide, 2)), nn.Sequential(*_same(wide, wide))
            )
            for wide, narrow in steps
        )

    def compress(self, x: Tensor) -> Tensor:
        for step in self.encoder:
            x = step(x)
        return x

    def restore(self, x: Tensor) -> Tensor:
        for step in reversed(list(self.decoder)):
            x = step(x)
        return x


class _Backbone(nn.Module):
    def __init__(self, config: BackboneConfig, inputs: int) -> None:
        super().__init__()
        self.blocks, self.deblocks = nn.ModuleList(), nn.ModuleList()
        compressors = []
        for level, outputs in enumerate(config.filters):
            layers = _halving(inputs, outputs, config.strides[level])
            for _ in range(config.layers[level]):
                layers += _same(outputs, outputs)
            self.blocks.append(nn.Sequential(*layers))
            wide = config.upsampled_filters[level]
            self.deblocks.append(nn.Sequential(*_growing(outputs, wide, config.upsampling[level])))
            if config.compression > level:
                compressors.append(_Compressor(outputs, config.compression - level))
            inputs = outputs
        if compressors:
            self.compression_modules = nn.ModuleList(compressors)
        self._compressors = tuple(compressors)

    def send(self, pillar_map: Tensor) -> Tensor:
        """The first level's map as it travels: all that the ego needs of a vehicle."""
        first: Tensor = self.blocks[0](pillar_map)
        return self._compressors[0].compress(first) if self._compressors else first

    def receive(self, sent: Sequence[Tensor]) -> Tensor:
        """What vehicles sent, the ego's own first, fused to one map at the first resolution."""
        first = self._compressors[0].restore if self._compressors else nn.Identity()
        maps: list[Tensor] = [first(one) for one in sent]
        fused = []
        for level, widen in enumerate(self.deblocks):
            if level > 0:
                maps = [self.blocks[level](one) for one in maps]
                if level < len(self._compressors):
                    again = self._compressors[level]
                    maps = [again.restore(again.compress(one)) for one in maps]
            fused.append(widen(attend(maps)))
        return torch.cat(fused, dim=1)


def attend(maps: Sequence[Tensor]) -> Tensor:
    """Per-cell attention of the first map over all maps, each (1, C, H, W); one map stays itself.

    Scaled dot-product attention (Vaswani et al., 2017) with cells as vectors of C channels, of
    which AttFuse keeps the row of the ego.
    """
    own = maps[0]
    scores = torch.stack([(own * one).sum(dim=1) for one in maps]) / own.shape[1] ** 0.5
    weights = scores.softmax(dim=0)
    total = torch.zeros_like(own)
    for weight, one in zip(weights, maps, strict=True):
        total += weight[:, None] * one
    return total


class PointPillarNetwork(nn.Module):
    """Either model: with one map, attention leaves it as it is."""

    def __init__(self, config: OpenCoodConfig) -> None:
        super().__init__()
        self.pillar_vfe = _PillarEncoder(config)
        self.backbone = _Backbone(config.backbone, config.pillar_channels)
        features, anchors = sum(config.backbone.upsampled_filters), len(config.anchor_yaws)
        self.cls_head = nn.Conv2d(features, anchors, 1)
        self.reg_head = nn.Conv2d(features, 7 * anchors, 1)

    def encode(self, pillars: Pillars) -> Tensor:
        """A vehicle's map as it travels, float32 (1, C, H, W)."""
        return self.backbone.send(self.pillar_vfe(pillars))

    def heads(self, sent: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Score logits (A, H, W) and box offsets (7 A, H, W) from what vehicles sent, the ego's
        own first."""
        features = self.backbone.receive(sent)
        return self.cls_head(features)[0], self.reg_head(features)[0]
