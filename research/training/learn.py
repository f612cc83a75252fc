"""One training step: all clouds of a batch through the encoder, each sample's maps through fusion,
the fused maps through the decoder."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from perception.codec.features import LEVELS
from perception.detector.grid import BevConfig
from perception.detector.network import Network
from perception.detector.pillars import pillarise
from perception.fusion.maps import attend, strongest
from research.training.losses import box_losses, heat_loss
from research.training.plans import Plan
from research.training.stream import Batch

WARM_UP = 0.05
"""Share of the steps over which the learning rate rises."""
LAST_RATE = 0.01
"""Of the highest learning rate, at the end."""
VIEW_WEIGHT = 0.5
IOU_WEIGHT = 0.5


def rate_at(plan: Plan, step: int) -> float:
    """The learning rate: linear rise, then half a cosine."""
    begin = WARM_UP * plan.steps
    if step < begin:
        return plan.rate * min(1.0, (step + 1) / begin)
    way = (step - begin) / max(1.0, plan.steps - begin)
    return plan.rate * (LAST_RATE + (1 - LAST_RATE) * 0.5 * (1 + math.cos(math.pi * way)))


def losses(network: Network, config: BevConfig, batch: Batch, seed: int) -> dict[str, Tensor]:
    """The parts of the loss of one batch; `total` is what is minimised."""
    rng = np.random.default_rng([seed, batch.step, 1_000_000])
    device = next(network.parameters()).device
    maps = network.encoder(pillarise([cloud.to(device) for cloud in batch.clouds], config))
    seen = network.encoder.look(maps)
    fused = torch.stack(
        [
            _fuse(own, chance, rng)
            for own, chance in zip(
                torch.split(maps, batch.counts),
                torch.split(seen[:, 0].sigmoid(), batch.counts),
                strict=True,
            )
        ]
    )
    heat, channels = network.decoder(fused)
    fine, views = batch.fused, batch.views
    parts = {"heat": heat_loss(heat, fine.heat.to(device), fine.counted.to(device))}
    parts["boxes"], parts["iou"] = box_losses(config, channels, fine)
    any_heat = views.heat.amax(dim=1).to(device)
    any_counted = views.counted.amin(dim=1).to(device)
    parts["view"] = heat_loss(seen[:, 0], any_heat, any_counted)
    if len(views.map):
        told = seen[views.map, 1:, views.row, views.column]
        parts["view"] = parts["view"] + (told - views.boxes[:, :2].to(device)).abs().mean()
    parts["total"] = (
        parts["heat"] + parts["boxes"] + IOU_WEIGHT * parts["iou"] + VIEW_WEIGHT * parts["view"]
    )
    return parts


def _fuse(maps: Tensor, chance: Tensor, rng: np.random.Generator) -> Tensor:
    """One sample's maps (K, C, rows, columns), rounded and thinned as they would be on the wire."""
    if len(maps) == 1:
        return maps[0]
    fuse = attend if rng.random() < 0.5 else strongest
    present = torch.ones_like(chance, dtype=torch.bool)
    if rng.random() < 0.5:
        present = chance.detach() > float(10.0 ** rng.uniform(-2.5, -1.0))
        present[0] = True
    # The rounding passes its gradient on as if it were not there.
    steps = maps + ((maps * LEVELS).round() / LEVELS - maps).detach()
    return fuse(torch.cat([maps[:1], steps[1:]]), present)
