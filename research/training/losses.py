"""What training minimises."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from perception.boxes import iou_bev
from perception.detector.grid import BevConfig
from perception.detector.heads import boxes_at
from perception.types import Boxes
from research.training.targets import Targets

BOX_WEIGHTS = (2.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
APART_M = 10_000.0


def heat_loss(logits: Tensor, heat: Tensor, counted: Tensor) -> Tensor:
    """Focal loss of CornerNet (Law and Deng, ECCV 2018), alpha 2, beta 4, per object."""
    chance = torch.sigmoid(logits).clamp(1e-4, 1 - 1e-4)
    middle = (heat == 1.0).float()
    found = middle * (1 - chance) ** 2 * torch.log(chance)
    false = (1 - middle) * (1 - heat) ** 4 * chance**2 * torch.log(1 - chance) * counted
    return -(found.sum() + false.sum()) / middle.sum().clamp(min=1.0)


def box_losses(config: BevConfig, channels: Tensor, targets: Targets) -> tuple[Tensor, Tensor]:
    """L1 of the taught cells' boxes, and of their IoU against what they really reach."""
    if not len(targets.map):
        nothing = channels.sum() * 0.0
        return nothing, nothing
    told = channels[targets.map, :, targets.row, targets.column]
    weight = targets.weight / targets.weight.sum()
    apart = (told[:, :8] - targets.boxes).abs() @ told.new_tensor(BOX_WEIGHTS)
    reached = told.new_tensor(_iou(config, told.detach().cpu(), targets))
    quality = functional.binary_cross_entropy_with_logits(told[:, 8], reached, reduction="none")
    return (apart * weight).sum(), (quality * weight).sum()


def _iou(config: BevConfig, told: Tensor, targets: Targets) -> list[float]:
    labels = np.array([config.labels.index(label) for label in targets.truth.labels])
    boxes = boxes_at(
        config,
        told.numpy().astype(np.float64),
        targets.row.numpy(),
        targets.column.numpy(),
        labels,
        np.ones(len(labels)),
    )
    # Each pair far from the others: only a cell and its own box are compared.
    away = np.zeros((len(labels), 3))
    away[:, 0] = np.arange(len(labels)) * APART_M
    shared = iou_bev(_moved(boxes, away), _moved(targets.truth, away))
    return [float(value) for value in np.diagonal(shared)]


def _moved(boxes: Boxes, by: NDArray[np.float64]) -> Boxes:
    return Boxes(boxes.centers + by, boxes.sizes, boxes.headings, boxes.scores, boxes.labels)
