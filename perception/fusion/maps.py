"""Fusing feature maps that lie in one frame, cell by cell. Neither way has weights of its own."""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from perception.kernels.convolution import PANEL
from perception.kernels.library import network, pointer
from swarm.geometry import Matrix

MOST_IN_C = 256
MIN_SHARE = 0.4
"""Of the cells around a place that must be present for it to be."""


@dataclass(frozen=True, slots=True, eq=False)
class SentMap:
    """A robot's map in the ego's frame."""

    cells: Tensor
    """float32 (C, rows, columns)."""
    present: Tensor
    """bool (rows, columns): where the robot has sent anything."""

    def moved(self, half: tuple[float, float], by: Matrix) -> SentMap:
        """The map under a correction of its sender: see `moved`. Itself where there is none."""
        if np.array_equal(by, np.eye(4)):
            return self
        with torch.inference_mode():
            return SentMap(*moved(self.cells, self.present, half, by))


def attend(maps: Tensor, present: Tensor) -> Tensor:
    """Attention of the ego's cell over the robots' (AttFuse: Xu et al., "OPV2V", ICRA 2022).

    maps: float32 (K, C, rows, columns), the ego's first; present: bool (K, rows, columns), which
    cells each robot has sent, the ego's all. Returns (C, rows, columns).
    """
    own, compiled = maps[0], network()
    learns = torch.is_grad_enabled() or not maps[0].is_cpu
    if compiled is not None and not learns and len(own) % PANEL == 0 and len(maps) <= MOST_IN_C:
        return _attend_in_c(compiled, maps, present)
    # One map after the other stays in the processor's cache.
    scores = torch.stack([(own * one).sum(dim=0) for one in maps]) / math.sqrt(len(own))
    weights = torch.softmax(scores.masked_fill(~present, -math.inf), dim=0)
    fused = weights[0] * own
    for weight, one in zip(weights[1:], maps[1:], strict=True):
        fused = torch.addcmul(fused, weight, one)
    return fused


def _attend_in_c(compiled: ctypes.CDLL, maps: Tensor, present: Tensor) -> Tensor:
    rows = [one.permute(1, 2, 0).contiguous().numpy() for one in maps]
    said = [one.contiguous().numpy() for one in present]
    fused = np.empty_like(rows[0])
    many = ctypes.c_void_p * len(maps)
    compiled.attend(
        *(many(*map(pointer, rows)), many(*map(pointer, said)), len(maps)),
        *(said[0].size, len(maps[0]), pointer(fused)),
    )
    return torch.from_numpy(fused).permute(2, 0, 1)


def moved(
    maps: Tensor, present: Tensor, half: tuple[float, float], by: Matrix
) -> tuple[Tensor, Tensor]:
    """A map (C, rows, columns) and its present cells under a turn and shift of the ground plane.

    half: half of the map's extent along x and y, metres; by: 4 x 4, in the frame of the map.
    Values between cells are interpolated over the cells that are present.
    """
    back = np.linalg.inv(by)
    x, y = half
    theta = torch.tensor(
        [
            [back[0, 0], back[0, 1] * y / x, back[0, 3] / x],
            [back[1, 0] * x / y, back[1, 1], back[1, 3] / y],
        ],
        dtype=torch.float32,
    )
    weight = present[None].to(maps.dtype)
    both = torch.cat([maps * weight, weight])[None]
    grid = functional.affine_grid(theta[None], list(both.shape), align_corners=False)
    sampled = functional.grid_sample(both, grid, align_corners=False)[0]
    share = sampled[-1]
    here = share >= MIN_SHARE
    return sampled[:-1] / share.clamp(min=MIN_SHARE) * here, here


def strongest(maps: Tensor, present: Tensor) -> Tensor:
    """The largest value of each channel (F-Cooper: Chen et al., SEC 2019); as `attend`."""
    fused = maps[0]
    for one, here in zip(maps[1:], present[1:], strict=True):
        fused = torch.maximum(fused, one * here)
    return fused
