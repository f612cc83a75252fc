"""The surrogate's network: three dense layers, read from safetensors and run with NumPy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from ego_agent.plan.surrogate.features import NAMES
from swarm.errors import DecisionError

WEIGHTS = Path(__file__).parent / "surrogate.safetensors"
LAYERS = 3
_FACTS = "facts"
_ALLOWED_BYTES = 1_000_000


@dataclass(frozen=True)
class Surrogate:
    """Predicts AP@0.7 of choices from their features."""

    algorithms: tuple[str, ...]
    """Those it knows, in the order of their columns."""
    weights: tuple[NDArray[np.float32], ...]
    """(out, in) of each layer."""
    biases: tuple[NDArray[np.float32], ...]
    facts: dict[str, str]
    """What it was trained on."""

    def knows(self, *algorithms: str) -> bool:
        """Whether it has learnt from choices with all of these."""
        return set(algorithms) <= set(self.algorithms)

    def predict(self, features: NDArray[np.float32]) -> NDArray[np.float64]:
        """Predicted precision in (0, 1): float32 (n, inputs) to float64 (n,)."""
        x = features
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.maximum(x @ weight.T + bias, 0.0)
        logit = (x @ self.weights[-1].T + self.biases[-1])[:, 0].astype(np.float64)
        return 1.0 / (1.0 + np.exp(-logit))


def write_surrogate(path: Path, model: Surrogate) -> None:
    """Writes the model; equal models make equal files."""
    tensors = {}
    for index, (weight, bias) in enumerate(zip(model.weights, model.biases, strict=True)):
        tensors[f"weight{index}"] = np.ascontiguousarray(weight)
        tensors[f"bias{index}"] = np.ascontiguousarray(bias)
    facts = {**model.facts, "features": list(NAMES), "algorithms": list(model.algorithms)}
    path.write_bytes(save(tensors, metadata={_FACTS: json.dumps(facts, sort_keys=True)}))


def read_surrogate(path: Path = WEIGHTS) -> Surrogate:
    """The model in a file. Raises DecisionError when it is missing, is no safetensors file, or was
    trained on other features."""
    try:
        if path.stat().st_size > _ALLOWED_BYTES:
            raise DecisionError(f"surrogate {path} is larger than {_ALLOWED_BYTES} bytes")
        with safe_open(path, framework="np") as file:
            facts = json.loads((file.metadata() or {}).get(_FACTS, "{}"))
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except FileNotFoundError as error:
        raise DecisionError(
            f"there is no surrogate {path}; coadapt eval train-surrogate"
        ) from error
    except (OSError, SafetensorError, ValueError) as error:
        raise DecisionError(f"{path} is not a safetensors file: {error}") from error
    features = tuple(facts.pop("features", ()))
    algorithms = tuple(facts.pop("algorithms", ()))
    if features != NAMES or not algorithms:
        raise DecisionError(f"surrogate {path} was trained on other features: train it again")
    try:
        weights = tuple(tensors[f"weight{index}"] for index in range(LAYERS))
        biases = tuple(tensors[f"bias{index}"] for index in range(LAYERS))
    except KeyError as error:
        raise DecisionError(f"surrogate {path} has no {error}") from error
    shapes = [weight.shape for weight in weights]
    wide = [len(NAMES) + len(algorithms), *(len(bias) for bias in biases)]
    if wide[-1] != 1 or shapes != list(zip(wide[1:], wide[:-1], strict=True)):
        raise DecisionError(f"surrogate {path} has layers of {shapes} for {wide[0]} inputs")
    if not all(np.isfinite(tensor).all() for tensor in tensors.values()):
        raise DecisionError(f"surrogate {path} holds numbers that are not finite")
    return Surrogate(algorithms, weights, biases, facts)


@cache
def packaged_surrogate() -> Surrogate:
    """The model that comes with the project. Raises DecisionError as `read_surrogate` does."""
    return read_surrogate()
