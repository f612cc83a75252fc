"""What the heads should say: heatmaps around the middles of boxes, and the boxes themselves.

After CenterPoint (Yin et al., CVPR 2021), with every cell near a middle taught its box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perception.detector.grid import BevConfig
from perception.types import Boxes

MIN_HITS = 4
"""An object with fewer points is neither asked for nor punished."""
MIN_SPREAD = 0.6
"""Standard deviation of a heatmap's peak, cells."""
TAUGHT = 1
"""Cells around the middle, on each side, that are taught the box."""


@dataclass(frozen=True, slots=True)
class Targets:
    """Of B feature maps; K taught cells in all."""

    heat: Tensor
    """float32 (B, classes, rows, columns): 1 at middles."""
    counted: Tensor
    """float32 (B, classes, rows, columns): 0 where nothing can be said."""
    map: Tensor
    """int64 (K,): map of each taught cell."""
    row: Tensor
    column: Tensor
    boxes: Tensor
    """float32 (K, 8): the box channels without IoU."""
    weight: Tensor
    """float32 (K,)"""
    truth: Boxes
    """(K,): the box that each cell is taught."""


def make_targets(config: BevConfig, boxes: list[Boxes], hits: list[NDArray[np.int64]]) -> Targets:
    """Targets of one map for each entry; `hits` (N,) are the points on each box."""
    rows, columns = config.cells
    heat = np.zeros((len(boxes), len(config.labels), rows, columns), dtype=np.float32)
    counted = np.ones_like(heat)
    cells: list[tuple[int, int, int]] = []
    taught: list[NDArray[np.float64]] = []
    weights: list[float] = []
    parts: list[Boxes] = []
    for number, (truth, seen) in enumerate(zip(boxes, hits, strict=True)):
        for i in np.flatnonzero(seen > 0):
            middle = cell_of(config, truth.centers[i])
            if not (0 <= middle[0] < columns and 0 <= middle[1] < rows):
                continue
            label = config.labels.index(truth.labels[i])
            spread = max(MIN_SPREAD, float(truth.sizes[i, :2].min()) / config.cell_m / 4)
            window = _window(middle, 3 * spread, rows, columns)
            peak = _peak(middle, spread, window)
            if seen[i] < MIN_HITS:
                counted[number, label][window] *= peak < 0.1
                continue
            place = heat[number, label][window]
            np.maximum(place, peak, out=place)
            column, row = int(middle[0]), int(middle[1])
            heat[number, label, row, column] = 1.0
            for r in range(max(0, row - TAUGHT), min(rows, row + TAUGHT + 1)):
                for c in range(max(0, column - TAUGHT), min(columns, column + TAUGHT + 1)):
                    cells.append((number, r, c))
                    taught.append(_channels(config, truth, int(i), label, middle, r, c))
                    weights.append(1.0 if (r, c) == (row, column) else 0.25)
                    parts.append(truth.take(np.array([i])))
    where = np.array(cells, dtype=np.int64).reshape(-1, 3)
    table = np.array(taught, dtype=np.float32).reshape(-1, 8)
    return Targets(
        heat=torch.from_numpy(heat),
        counted=torch.from_numpy(counted),
        map=torch.from_numpy(where[:, 0].copy()),
        row=torch.from_numpy(where[:, 1].copy()),
        column=torch.from_numpy(where[:, 2].copy()),
        boxes=torch.from_numpy(table),
        weight=torch.tensor(weights, dtype=torch.float32),
        truth=Boxes.concatenate(parts),
    )


def cell_of(config: BevConfig, center: NDArray[np.float64]) -> NDArray[np.float64]:
    """Column and row of a point (x, y, ...), with fractions: cell i reaches from i to i + 1."""
    low = np.array([-config.half_x_m, -config.half_y_m])
    place: NDArray[np.float64] = (center[:2] - low) / config.cell_m
    return place


def _channels(
    config: BevConfig,
    truth: Boxes,
    i: int,
    label: int,
    middle: NDArray[np.float64],
    row: int,
    column: int,
) -> NDArray[np.float64]:
    turned = config.symmetry[label] * truth.headings[i]
    return np.array(
        [
            middle[0] - column - 0.5,
            middle[1] - row - 0.5,
            truth.centers[i, 2],
            *np.log(truth.sizes[i]),
            np.cos(turned),
            np.sin(turned),
        ]
    )


def _window(
    middle: NDArray[np.float64], reach: float, rows: int, columns: int
) -> tuple[slice, slice]:
    low = np.maximum(np.floor(middle - reach).astype(int), 0)
    high = np.ceil(middle + reach).astype(int) + 1
    return slice(low[1], min(high[1], rows)), slice(low[0], min(high[0], columns))


def _peak(
    middle: NDArray[np.float64], spread: float, window: tuple[slice, slice]
) -> NDArray[np.float32]:
    """A Gaussian that is 1 in the middle of the cell that holds the box's middle."""
    column, row = np.floor(middle)
    y = np.arange(window[0].start, window[0].stop)[:, None] - row
    x = np.arange(window[1].start, window[1].stop)[None, :] - column
    peak: NDArray[np.float32] = np.exp(-(x * x + y * y) / (2 * spread**2)).astype(np.float32)
    return peak
