"""Writes an adaptation as llama.cpp loads it beside its model: GGUF, half precision."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from research.training.wishes import gguf_file
from research.training.wishes.lora import ALPHA, adapted


def export(model: nn.Module, path: Path, *, name: str) -> None:
    """Writes the adapted layers of a model from `llama`, whose names are GGUF's."""
    facts: dict[str, str | float] = {
        "general.architecture": "llama", "general.type": "adapter", "general.name": name,
        "adapter.type": "lora", "adapter.lora.alpha": ALPHA,
    }  # fmt: skip
    tensors = {}
    for layer_name, layer in adapted(model):
        tensors[f"{layer_name}.weight.lora_a"] = _half(layer.a)
        tensors[f"{layer_name}.weight.lora_b"] = _half(layer.b)
    gguf_file.write(path, facts, tensors)


def restore(model: nn.Module, path: Path) -> None:
    """Sets the adapted layers of a model to those of a file that `export` wrote. Raises KeyError
    for a layer that it does not have."""
    _, tensors = gguf_file.read(path)
    for layer_name, layer in adapted(model):
        for side, parameter in (("a", layer.a), ("b", layer.b)):
            held = np.array(tensors[f"{layer_name}.weight.lora_{side}"], np.float32)
            parameter.data.copy_(torch.from_numpy(held))


def _half(parameter: nn.Parameter) -> npt.NDArray[Any]:
    return parameter.detach().float().cpu().numpy().astype(np.float16)
