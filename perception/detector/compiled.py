"""The network in C (perception/kernels/network.c): what `perception.detector.network` computes, up
to rounding, in a third of the time.

Images are float32 (rows, columns, channels) here; feature maps leave as views with the channels
first.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from perception.detector.grid import PILLARS_OF_CELL, BevConfig
from perception.detector.network import BOX_CHANNELS, EVIDENCE, FEATURES, Decoder, Encoder
from perception.detector.pillars import thinned
from perception.kernels.convolution import PANEL, Convolution, Workers, reached, tiles
from perception.kernels.library import pointer

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]


class CompiledEncoder:
    """Points to their feature map."""

    def __init__(self, encoder: Encoder, config: BevConfig, workers: Workers) -> None:
        """`encoder`: with its norms folded into the layers before them."""
        self._config = config
        self._workers = workers
        linear, down = encoder.points[0], encoder.down[0]
        assert isinstance(linear, nn.Linear)
        assert isinstance(down, nn.Conv2d)
        assert linear.bias is not None
        assert down.bias is not None
        width = linear.out_features
        # (7, 32) and the bias as an eighth row, as the loop over points reads them.
        layer = torch.cat([linear.weight.T, linear.bias[None]])
        self._layer = layer.detach().contiguous().numpy()
        taps = down.weight.detach().view(width, -1).T.reshape(-1, width // PANEL, PANEL)
        self._down = taps.permute(1, 0, 2).contiguous().numpy()
        self._down_bias = down.bias.detach().numpy().copy()
        self._near = _Residual(encoder.near, workers)
        self._wide_down = _layer(encoder.wide_down, workers)
        self._wide = _Residual(encoder.wide, workers)
        self._wide_up = _layer(encoder.wide_up, workers)
        self._merge = _layer(encoder.merge, workers)
        self._shared = _layer(encoder.shared, workers)

    def __call__(self, points: Floats) -> Tensor:
        """The feature map (FEATURES, rows, columns) of a cloud (N, 3) in the frame of the map."""
        rows, columns = self._config.cells
        buffer = self._workers.buffer
        image, filled = self._image(points)
        said = reached(filled, EVIDENCE)
        # What a cell says depends on those around it, and on the half resolution around them.
        merged = reached(said)
        halves = _halved(merged)
        near = buffer("near", image.shape)
        self._near(image, near, merged | _doubled(reached(halves, 2), merged.shape, 1))
        half = (-(-rows // 2), -(-columns // 2), self._wide_down.after)
        wide = buffer("wide", half)
        self._wide_down(near, wide)
        wider = buffer("wider", half)
        self._wide(wide, wider, halves)
        self._wide_up(wider, image, add=near, repeat=2)
        self._merge(image, near, needed=tiles(said))
        features = np.empty((rows, columns, FEATURES), np.float32)
        self._shared(near, features)
        self._workers.library.limit(pointer(features), pointer(said), rows * columns, FEATURES)
        return torch.from_numpy(features).permute(2, 0, 1)

    def _image(self, points: Floats) -> tuple[Floats, Flags]:
        config, library, buffer = self._config, self._workers.library, self._workers.buffer
        rows, columns = config.cells
        cloud = np.ascontiguousarray(thinned(points))
        image = buffer("image", (rows, columns, len(self._down_bias)))
        filled = np.empty((rows, columns), np.bool_)
        most = min(len(cloud), rows * columns)
        seen = buffer("seen", (most, (PILLARS_OF_CELL + 1) * len(self._down_bias)))
        ints = buffer("ints", (library.image_scratch(rows, columns, len(cloud)),))
        library.image(
            *(pointer(cloud), len(cloud), config.half_x_m, config.half_y_m),
            *(config.low_z_m, config.high_z_m, config.pillar_m, rows, columns),
            *(pointer(self._layer), pointer(self._down), pointer(self._down_bias)),
            *(pointer(image), pointer(filled), pointer(ints), pointer(seen)),
        )
        return image, filled


class CompiledDecoder:
    """A fused feature map to heat logits and box channels."""

    def __init__(self, decoder: Decoder, workers: Workers) -> None:
        """`decoder`: with its norms folded into the layers before them."""
        self._workers = workers
        self._enter, self._near = _layer(decoder.enter, workers), _layer(decoder.near, workers)
        self._down = _layer(decoder.down, workers)
        self._wide = [_Residual(part, workers) for part in decoder.wide]
        self._up = _layer(decoder.up, workers)
        self._merge = [_layer(part, workers) for part in decoder.merge]  # type: ignore[arg-type]
        self._classes = decoder.heat.out_channels
        told = [decoder.heat, decoder.boxes]
        weights = torch.cat([part.weight for part in told]).detach().numpy()
        bias = torch.cat([part.bias for part in told if part.bias is not None]).detach().numpy()
        self._told = Convolution(workers, weights, bias, relu=False)

    def __call__(self, fused: Floats, wanted: Flags | None = None) -> tuple[Tensor, Tensor]:
        """Heat logits (classes, rows, columns) and box channels (BOX_CHANNELS, rows, columns) of a
        map (rows, columns, FEATURES).

        `wanted` (rows, columns): where they must be right; the rest may be anything finite.
        """
        rows, columns, _ = fused.shape
        wanted = np.ones((rows, columns), np.bool_) if wanted is None else wanted
        # What each layer's next one reads, from the last to the first.
        joined = reached(wanted)
        read = reached(joined)
        halves = _halved(read)
        entered = read | _doubled(reached(halves, 4), wanted.shape, 1)
        buffer = self._workers.buffer
        near, narrow = self._near.after, buffer("narrow", (rows, columns, self._near.after))
        self._enter(fused, narrow, needed=tiles(reached(entered)))
        both = buffer("both", (rows, columns, near + self._up.after))
        self._near(narrow, both[..., :near], needed=tiles(entered))
        half = (-(-rows // 2), -(-columns // 2), self._down.after)
        wide, other = buffer("wide", half), buffer("wider", half)
        self._down(both[..., :near], wide)
        for residual, steps in zip(self._wide, (2, 0), strict=True):
            residual(wide, other, reached(halves, steps))
            wide, other = other, wide
        self._up(wide, both[..., near:], repeat=2)
        self._merge[0](both, narrow, needed=tiles(joined))
        merged = buffer("merged", (rows, columns, self._merge[1].after))
        self._merge[1](narrow, merged, needed=tiles(wanted))
        told = np.empty((rows, columns, self._told.after), np.float32)
        self._told(merged, told)
        channels = torch.from_numpy(told).permute(2, 0, 1)
        return channels[: self._classes], channels[self._classes :][:BOX_CHANNELS]


class _Residual:
    def __init__(self, residual: nn.Module, workers: Workers) -> None:
        self._workers = workers
        self._first = _layer(residual.first, workers)  # type: ignore[arg-type]
        self._second = _layer(residual.second, workers, relu=True)  # type: ignore[arg-type]

    def __call__(self, image: Floats, out: Floats, wanted: Flags) -> None:
        """`wanted` (rows, columns): where `out` must be right."""
        between = self._workers.buffer("between", image.shape)
        self._first(image, between, needed=tiles(reached(wanted)))
        self._second(between, out, add=image, needed=tiles(wanted))


def _layer(part: nn.Sequential, workers: Workers, *, relu: bool | None = None) -> Convolution:
    """The convolution of a part, with the ReLU at its end, if it has one."""
    convolution = part[0]
    assert isinstance(convolution, nn.Conv2d)
    assert convolution.bias is not None
    ends_positive = isinstance(part[-1], nn.ReLU) if relu is None else relu
    return Convolution(
        workers,
        convolution.weight.detach().numpy(),
        convolution.bias.detach().numpy(),
        convolution.stride[0],
        relu=ends_positive,
    )


def _halved(cells: Flags) -> Flags:
    """Which cells of half the resolution hold one that is true."""
    rows, columns = cells.shape
    even = np.pad(cells, ((0, rows % 2), (0, columns % 2)))
    rowwise = even[::2] | even[1::2]
    return rowwise[:, ::2] | rowwise[:, 1::2]


def _doubled(cells: Flags, shape: tuple[int, ...], around: int) -> Flags:
    """Which cells of twice the resolution, of this shape, lie in one that is true, or `around`
    cells beside it: what a stride of 2 reads."""
    fine = cells.repeat(2, axis=0).repeat(2, axis=1)[: shape[0], : shape[1]]
    return reached(fine, around)
