"""A run on disk: weights, averaged weights and optimiser in one safetensors file; the curve as JSON
lines. Nothing is pickled."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from swarm.errors import PerceptionError
from swarm.files import whole_file

Tensors = dict[str, Tensor]


def save(path: Path, step: int, parts: dict[str, Tensors], facts: dict[str, str]) -> None:
    """Writes the state of a run; a reader finds the old one or the new one."""
    flat = {
        f"{part}/{name}": tensor.detach().cpu().contiguous()
        for part, tensors in parts.items()
        for name, tensor in tensors.items()
    }
    with whole_file(path) as part:
        save_file(flat, part, metadata={**facts, "step": str(step)})


def load(path: Path) -> tuple[int, dict[str, Tensors], dict[str, str]]:
    """Step, parts and facts of a run. Raises PerceptionError for a file that is no such state."""
    parts: dict[str, Tensors] = {}
    try:
        with safe_open(path, framework="pt") as file:
            facts = dict(file.metadata() or {})
            for key in file.keys():  # noqa: SIM118 - not a mapping
                part, _, name = key.partition("/")
                parts.setdefault(part, {})[name] = file.get_tensor(key)
        return int(facts.pop("step")), parts, facts
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise PerceptionError(f"{path} is not the state of a training run: {error}") from error


def optimiser_tensors(optimiser: torch.optim.Optimizer) -> Tensors:
    """The state of AdamW as named tensors."""
    state: dict[int, dict[str, Any]] = optimiser.state_dict()["state"]
    return {f"{i}/{name}": value for i, one in state.items() for name, value in one.items()}


def restore_optimiser(optimiser: torch.optim.Optimizer, tensors: Tensors) -> None:
    """The reverse of `optimiser_tensors`."""
    whole = optimiser.state_dict()
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        number, _, name = key.partition("/")
        state.setdefault(int(number), {})[name] = value
    optimiser.load_state_dict({**whole, "state": state})


class Curve:
    """What was measured along a run, one JSON object a line."""

    def __init__(self, path: Path, begin: int) -> None:
        self._path = path
        kept = [line for line in _lines(path) if json.loads(line)["step"] <= begin]
        path.write_text("".join(f"{line}\n" for line in kept))

    def add(self, **facts: float) -> None:
        """Appends a line."""
        with self._path.open("a") as file:
            file.write(json.dumps({key: round(value, 6) for key, value in facts.items()}) + "\n")


def _lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.exists() else []
