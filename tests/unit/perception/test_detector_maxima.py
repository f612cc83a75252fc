"""The largest value around each cell, against PyTorch's max pooling."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from perception.detector.maxima import largest_around


@pytest.mark.parametrize("cells", [1, 3])
@pytest.mark.parametrize("shape", [(3, 16, 20), (2, 1, 5, 4), (1, 1, 1)])
def test_largest_around_equals_max_pooling(shape: tuple[int, ...], cells: int) -> None:
    maps = torch.rand(shape, generator=torch.Generator().manual_seed(1))
    pooled = functional.max_pool2d(
        maps.reshape(-1, 1, *shape[-2:]), 2 * cells + 1, stride=1, padding=cells
    )
    assert torch.equal(largest_around(maps, cells), pooled.reshape(shape))
