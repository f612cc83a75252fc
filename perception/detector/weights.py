"""Weights on disk: safetensors with what they are for. Nothing is unpickled."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from perception.detector.codebook import ENTRIES, PARTS
from perception.detector.grid import BevConfig, bev_config
from perception.detector.network import FEATURES, Network
from perception.detector.weight_files import weight_file
from swarm.errors import PerceptionError

ARCHITECTURE = "pillars-1"
"""Raise when the network changes: weights of another architecture are refused."""
_ALLOWED_BYTES = 8_000_000
_CODEBOOK = "codebook"
_FACTS = "facts"


@dataclass(frozen=True, slots=True)
class Weights:
    """A trained network, in evaluation mode, and which one it is."""

    config: BevConfig
    network: Network
    codebook: NDArray[np.float32]
    """(parts, entries, channels of a part): what `intermediate-codebook` sends the numbers of."""
    version: int
    """First 32 bits of the tensors' SHA-256: robots and ego must have the same."""


def save_weights(
    path: Path,
    name: str,
    tensors: dict[str, Tensor],
    codebook: NDArray[np.float32],
    facts: dict[str, str],
) -> None:
    """Writes the weights of the configuration `name`."""
    known = {**facts, "architecture": ARCHITECTURE, "config": name}
    plain = {key: tensor.detach().cpu().contiguous() for key, tensor in tensors.items()}
    plain[_CODEBOOK] = torch.from_numpy(codebook)
    # One string: safetensors writes several in any order, and equal weights shall be equal files.
    raw = save(plain, metadata={_FACTS: json.dumps(known, sort_keys=True)})
    if len(raw) > _ALLOWED_BYTES:
        raise PerceptionError(f"weights have {len(raw)} bytes; allowed: {_ALLOWED_BYTES}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(raw)


def load_weights(name: str, path: Path | None = None) -> Weights:
    """The weights of a configuration, the ones that come with the project unless told otherwise.

    Raises PerceptionError when the file is missing, is no safetensors file, or is for another
    configuration or architecture.
    """
    config = bev_config(name)
    path = path or weight_file(name)
    network = Network(config)
    try:
        size = path.stat().st_size
        if size > _ALLOWED_BYTES:
            raise PerceptionError(f"weights {path} have {size} bytes; allowed: {_ALLOWED_BYTES}")
        with safe_open(path, framework="pt") as file:
            facts = json.loads((file.metadata() or {}).get(_FACTS, "{}"))
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except FileNotFoundError as error:
        raise PerceptionError(f"there are no weights {path}; make train CONFIG={name}") from error
    except (OSError, SafetensorError, ValueError) as error:
        raise PerceptionError(f"{path} is not a safetensors file: {error}") from error
    for key, wanted in (("architecture", ARCHITECTURE), ("config", name)):
        if facts.get(key) != wanted:
            raise PerceptionError(
                f"weights {path} have {key} {facts.get(key)!r}; {wanted!r} is needed"
            )
    for key, tensor in tensors.items():
        if tensor.dtype.is_floating_point and not bool(tensor.isfinite().all()):
            raise PerceptionError(f"weights {path} hold numbers that are not finite in {key}")
    version = _version(tensors)
    try:
        codebook = tensors.pop(_CODEBOOK).numpy()
        network.load_state_dict(tensors)
    except (KeyError, RuntimeError) as error:
        raise PerceptionError(f"weights {path} do not fit the network: {error}") from error
    shape = (PARTS, ENTRIES, FEATURES // PARTS)
    if codebook.shape != shape:
        raise PerceptionError(f"the codebook of {path} has shape {codebook.shape}, not {shape}")
    return Weights(config, network.eval(), codebook, version)


def _version(tensors: dict[str, Tensor]) -> int:
    digest = hashlib.sha256()
    for key in sorted(tensors):
        digest.update(key.encode() + tensors[key].numpy().tobytes())
    return int.from_bytes(digest.digest()[:4], "little")
