"""Heatmaps and box channels to boxes."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perception.boxes import nms
from perception.detector.grid import BevConfig
from perception.types import Boxes
from swarm.geometry import wrap_heading

MAX_PEAKS = 150
MIN_SCORE = 0.05
LEAST_LOGIT = float(np.log(MIN_SCORE**2 / (1.0 - MIN_SCORE**2)))
"""Of a peak: with a predicted IoU of 1 its score is MIN_SCORE."""
MAX_SIZE_LOG = 4.0
"""Sides are at most 55 m: what an untrained network says must still be a box."""
QUALITY = 0.5
"""Share of the predicted IoU in a score, as an exponent: score = heat^(1 - q) * iou^q."""

Floats = NDArray[np.float64]


def read_boxes(
    config: BevConfig, heat: Tensor, channels: Tensor, said: NDArray[np.bool_] | None = None
) -> Boxes:
    """Boxes of one map, best score first, in the reference frame.

    heat: logits float32 (classes, rows, columns); channels: float32 (BOX_CHANNELS, rows, columns).
    `said`: bool (rows, columns), where boxes may be; everywhere when None.
    """
    # In NumPy: PyTorch hands this little to other threads, and waits for them longer than it works.
    logits = heat.detach().numpy()
    if said is not None:
        logits = np.where(said, logits, -np.inf)
    label, row, column = np.nonzero(logits > LEAST_LOGIT)
    likely = logits[label, row, column]
    around = np.pad(logits, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    peak = np.ones(len(likely), dtype=np.bool_)
    for down, right in product(range(3), repeat=2):
        peak &= likely >= around[label, row + down, column + right]
    best = np.flatnonzero(peak)
    best = best[np.argsort(-likely[best], kind="stable")[:MAX_PEAKS]]
    label, row, column = label[best], row[best], column[best]
    heat_score = 1.0 / (1.0 + np.exp(-likely[best].astype(np.float64)))
    told = channels[:, row, column].T.numpy().astype(np.float64)
    finite = np.isfinite(told).all(axis=1)
    told, row, column, label = told[finite], row[finite], column[finite], label[finite]
    heat_score = heat_score[finite]
    iou = 1.0 / (1.0 + np.exp(-np.clip(told[:, 8], -30.0, 30.0)))
    score = heat_score ** (1 - QUALITY) * iou**QUALITY
    found = boxes_at(config, told, row, column, label, score)
    return nms(found.take(score >= MIN_SCORE))


def boxes_at(
    config: BevConfig,
    told: Floats,
    row: NDArray[np.integer],
    column: NDArray[np.integer],
    label: NDArray[np.integer],
    score: Floats,
) -> Boxes:
    """The boxes that cells' channels (K, BOX_CHANNELS) describe, in the reference frame."""
    x = (column + 0.5 + told[:, 0]) * config.cell_m - config.half_x_m
    y = (row + 0.5 + told[:, 1]) * config.cell_m - config.half_y_m
    turns = np.array(config.symmetry)[label]
    heading = np.arctan2(told[:, 7], told[:, 6]) / turns
    return Boxes(
        centers=np.column_stack([x, y, told[:, 2]]),
        sizes=np.exp(np.clip(told[:, 3:6], -MAX_SIZE_LOG, MAX_SIZE_LOG)),
        headings=np.array([wrap_heading(float(turn)) for turn in heading], dtype=np.float64),
        scores=score,
        labels=tuple(config.labels[i] for i in label),
    )
