"""Points to pillars: what the network reads of each point, and which pillar it lies in.

After PointPillars (Lang et al., CVPR 2019), without absolute x and y: the same thing must look the
same wherever it stands, because merged clouds have no single sensor in their middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perception.detector.grid import PILLARS_OF_CELL, STRIDE, BevConfig

Cloud = TypeVar("Cloud", Tensor, NDArray[np.float32])

POINT_FEATURES = 7
MAX_POINTS = 400_000
"""More points of one cloud are thinned evenly: a full scan of 128 rings and 2,048 columns has
fewer, and nobody's cloud may hold up the frame of everybody."""


@dataclass(frozen=True, slots=True)
class Pillars:
    """M points that lie on the grid, of one or several clouds."""

    features: Tensor
    """float32 (M, POINT_FEATURES): offset from the pillar's mean (x, y, z), offset from the
    pillar's middle (x, y) in pillars, height, and how many points share the pillar (log)."""
    index: Tensor
    """int64 (M,): pillar of each point. The pillars of one cell of the feature map follow each
    other: ((cloud * rows + row of cell) * columns + column of cell) * PILLARS_OF_CELL + which."""
    clouds: int


def pillarise(clouds: list[Tensor], config: BevConfig) -> Pillars:
    """Clouds float32 (N, 3) in the reference frame, as pillars; points off the grid are left out,
    NaN and infinite ones among them."""
    points, offsets, index = [], [], []
    size = config.rows * config.columns
    for number, cloud in enumerate(clouds):
        cloud = thinned(cloud)
        x, y, z = cloud.unbind(1)
        inside = (x.abs() < config.half_x_m) & (y.abs() < config.half_y_m)
        inside &= (z > config.low_z_m) & (z < config.high_z_m)
        kept = cloud[inside]
        column = ((kept[:, 0] + config.half_x_m) / config.pillar_m).long()
        row = ((kept[:, 1] + config.half_y_m) / config.pillar_m).long()
        # float32 may round a point just below the edge up to it.
        column.clamp_(max=config.columns - 1)
        row.clamp_(max=config.rows - 1)
        middle_x = (column + 0.5) * config.pillar_m - config.half_x_m
        middle_y = (row + 0.5) * config.pillar_m - config.half_y_m
        cell = (row // STRIDE) * (config.columns // STRIDE) + column // STRIDE
        which = (row % STRIDE) * STRIDE + column % STRIDE
        index.append(cell * PILLARS_OF_CELL + which + number * size)
        points.append(kept)
        offsets.append(torch.stack([kept[:, 0] - middle_x, kept[:, 1] - middle_y], dim=1))
    merged, where = torch.cat(points), torch.cat(index)
    offset = torch.cat(offsets) / config.pillar_m
    return Pillars(_features(merged, offset, where, size * len(clouds)), where, len(clouds))


def thinned(cloud: Cloud) -> Cloud:
    """MAX_POINTS of a cloud (N, 3) at most."""
    return cloud[:: max(1, -(-len(cloud) // MAX_POINTS))]


def _features(points: Tensor, offset: Tensor, index: Tensor, pillars: int) -> Tensor:
    count = torch.bincount(index, minlength=pillars)
    sums = points.new_zeros(pillars, 3).index_add_(0, index, points)
    mine = count[index].to(points.dtype)
    mean = sums[index] / mine[:, None]
    return torch.stack(
        [
            points[:, 0] - mean[:, 0],
            points[:, 1] - mean[:, 1],
            points[:, 2] - mean[:, 2],
            offset[:, 0],
            offset[:, 1],
            points[:, 2],
            torch.log(mine) / 4.0,
        ],
        dim=1,
    )
