"""The codebook of a trained network: what its robots would send, in few numbers."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perception.detector.codebook import learn_codebook
from perception.detector.network import Network
from perception.detector.pillars import pillarise
from research.training.plans import Plan
from research.training.stream import make_batch

BATCHES = 40
MAX_CELLS = 60_000
"""Enough for 256 entries; k-means compares each with all."""
MIN_CHANCE = 0.02
"""Cells less likely to hold an object's middle are not sent."""


def codebook_of(plan: Plan, tensors: dict[str, Tensor]) -> NDArray[np.float32]:
    """float32 (parts, entries, channels of a part), learnt from batches after the plan's last."""
    config = plan.shown()
    network = Network(config)
    network.load_state_dict({name: tensor.cpu() for name, tensor in tensors.items()})
    network.eval()
    cells = []
    with torch.inference_mode():
        for step in range(plan.steps, plan.steps + BATCHES):
            maps = network.encoder(pillarise(make_batch(plan, step).clouds, config))
            chance = network.encoder.look(maps)[:, 0].sigmoid()
            cells.append(maps.permute(0, 2, 3, 1)[chance > MIN_CHANCE].numpy())
    found, rng = np.concatenate(cells), np.random.default_rng(plan.seed)
    if len(found) > MAX_CELLS:
        found = found[np.sort(rng.choice(len(found), MAX_CELLS, replace=False))]
    return learn_codebook(found, rng)
