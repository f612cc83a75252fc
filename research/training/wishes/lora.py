"""Low-rank adaptation: beside each frozen weight W a trained B A, of which `scale` B A is added.

Hu et al., "LoRA: Low-Rank Adaptation of Large Language Models", 2021.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from torch import nn

RANK = 16
ALPHA = 32.0


class Adapted(nn.Module):
    """A frozen linear layer and its adaptation."""

    def __init__(self, base: nn.Linear, rank: int = RANK, alpha: float = ALPHA) -> None:
        super().__init__()
        self.base = base
        self.scale = alpha / rank
        self.a = nn.Parameter(torch.empty(rank, base.in_features))
        self.b = nn.Parameter(torch.zeros(base.out_features, rank))
        nn.init.kaiming_uniform_(self.a, a=math.sqrt(5))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(..., in) to (..., out)."""
        low = nn.functional.linear(x, self.a.to(x.dtype))
        added: torch.Tensor = nn.functional.linear(low, self.b.to(x.dtype)) * self.scale
        return torch.add(self.base(x), added)


def adapt(model: nn.Module) -> list[nn.Parameter]:
    """Freezes a model, adapts all linear layers of its blocks, and returns what is trained."""
    model.requires_grad_(False)
    for parent in list(model.modules()):
        for name, child in list(parent.named_children()):
            if isinstance(child, nn.Linear):
                setattr(parent, name, Adapted(child))
    return [parameter for layer in adapted(model) for parameter in (layer[1].a, layer[1].b)]


def adapted(model: nn.Module) -> Iterator[tuple[str, Adapted]]:
    """The adapted layers by name."""
    for name, module in model.named_modules():
        if isinstance(module, Adapted):
            yield name, module
