"""What is compared to align a sender with the ego: places of objects in the ego's frame."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from perception.detector.grid import BevConfig
from perception.fusion.alignment import Alignment, align
from perception.types import Boxes
from swarm.geometry import Matrix

Floats = NDArray[np.float64]

MIN_SCORE = 0.3
MAX_LANDMARKS = 30


def of_boxes(boxes: Boxes) -> Floats:
    """The middles (N, 2) of the best boxes."""
    return boxes.centers[np.flatnonzero(boxes.scores >= MIN_SCORE)[:MAX_LANDMARKS], :2]


def of_view(config: BevConfig, seen: Tensor) -> Floats:
    """The places (N, 2) of the peaks of what a map shows (`Detector.look`), likeliest first."""
    chance = seen[0]
    highest = functional.max_pool2d(chance[None, None], 3, stride=1, padding=1)[0, 0]
    peaks = torch.where((chance == highest) & (chance >= MIN_SCORE), chance, 0.0)
    scores, places = peaks.flatten().topk(MAX_LANDMARKS)
    row, column = np.divmod(places[scores > 0].numpy(), config.cells[1])
    offset = seen[1:, row, column].numpy().astype(np.float64)
    x = (column + 0.5 + offset[0]) * config.cell_m - config.half_x_m
    y = (row + 0.5 + offset[1]) * config.cell_m - config.half_y_m
    return np.column_stack([x, y])


def correct(own: Floats, theirs: Floats, own_from_sender: Matrix, body: Floats) -> Alignment:
    """How a sender has to be moved, from what both see and from each other: the ego may see the
    sender's body, whose middle in the sender's frame is `body` (2,), and the sender the ego's.

    Raises PayloadError for a sender that does not align.
    """
    there = own_from_sender[:2, :2] @ body + own_from_sender[:2, 3]
    return align(np.vstack([own, body]), np.vstack([theirs, there]))
