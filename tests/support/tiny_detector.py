"""A detector on a small grid with random weights: fast, and as good as any for what must always
hold."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from perception.detector import grid
from perception.detector.codebook import ENTRIES, PARTS
from perception.detector.grid import BevConfig
from perception.detector.network import FEATURES, Network

TINY = BevConfig(
    name="tiny",
    half_x_m=6.4,
    half_y_m=4.8,
    low_z_m=-1.5,
    high_z_m=1.7,
    pillar_m=0.2,
    labels=("person", "robot", "forklift"),
    symmetry=(4, 2, 2),
)
"""64 columns and 48 rows of pillars, 32 and 24 of cells."""


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> BevConfig:
    """TINY, known by its name."""
    monkeypatch.setitem(grid._CONFIGS, TINY.name, TINY)
    return TINY


def random_network(config: BevConfig = TINY, seed: int = 0) -> Network:
    """A network in evaluation mode whose norms have statistics, as after training."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = Network(config)
        for module in network.modules():
            if isinstance(module, torch.nn.BatchNorm1d | torch.nn.BatchNorm2d):
                assert module.running_mean is not None
                assert module.running_var is not None
                module.running_mean.normal_(0.0, 0.2)
                module.running_var.uniform_(0.5, 2.0)
                torch.nn.init.uniform_(module.weight, 0.5, 1.5)
                torch.nn.init.normal_(module.bias, 0.0, 0.2)
    return network.eval()


def random_codebook(seed: int = 0) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    return rng.random((PARTS, ENTRIES, FEATURES // PARTS), dtype=np.float32)


def random_cloud(config: BevConfig = TINY, count: int = 2000, seed: int = 0) -> torch.Tensor:
    """Points all over the grid, float32 (N, 3)."""
    rng = np.random.default_rng(seed)
    high = np.array([config.half_x_m, config.half_y_m, config.high_z_m])
    low = np.array([-config.half_x_m, -config.half_y_m, config.low_z_m])
    return torch.from_numpy(rng.uniform(low, high, (count, 3)).astype(np.float32))
