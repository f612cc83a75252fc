"""What runs the network: PyTorch, or the loops in C, whichever takes this machine the least.

- `torch`: float32 in PyTorch; there on every machine, and what the others are held against.
- `compiled`: float32 in C, where there was a compiler. Up to rounding the same.
- `torch-bfloat16`: for processors that multiply in bfloat16, which others do at a fourth of the
  speed. Chances differ by up to 0.01.
"""

from __future__ import annotations

import os
import time
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval, fuse_linear_bn_eval

from perception.codec.features import Numerics
from perception.detector.compiled import CompiledDecoder, CompiledEncoder
from perception.detector.grid import BevConfig
from perception.detector.network import FEATURES, Network
from perception.detector.pillars import pillarise
from perception.kernels import library
from perception.kernels.convolution import Workers
from swarm.errors import PerceptionError

Floats = NDArray[np.float32]

AUTO = "auto"
SETTING = "COADAPT_DETECTOR_BACKEND"
ISA_BELOW_AMX = "AVX512_CORE_BF16"
"""oneDNN's name for what it may use at most where AMX may fault."""
KEPT_KERNELS = 32
"""oneDNN builds a kernel for every shape, and keeps 1024 where nothing is said; PyTorch keeps as
many once more. Hardly two clouds have as many pillars: an ego grew by 6 MB a second."""
_TRIAL_CELLS = 64
"""Side of the map that is decoded to see what it takes: some ten milliseconds."""
_TRIAL_POINTS = 8192
"""Of the cloud that is encoded for the same reason: about half of a scan without its ground."""
_TRIALS = 5
_BETTER = 0.9
"""Share of one's processor time that the next one must stay below to be taken instead."""
_TOLERANCE: dict[Numerics, float] = {"float32": 1e-3, "bfloat16": 0.03}
"""How far chances, and features on average, may be off those of float32 in PyTorch."""


class Backend(Protocol):
    """Runs a network."""

    name: str
    numerics: Numerics

    def encode(self, points: Floats) -> Tensor:
        """The feature map float32 (FEATURES, rows, columns) of a cloud (N, 3) in its frame."""
        ...

    def decode(self, fused: Tensor, wanted: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Heat logits float32 (classes, rows, columns) and box channels (BOX_CHANNELS, rows,
        columns) of a map float32 (FEATURES, rows, columns).

        `wanted`, bool (rows, columns): where they must be right; the rest may be anything finite.
        """
        ...


class TorchBackend:
    """The network in PyTorch."""

    def __init__(self, network: Network, config: BevConfig, numerics: Numerics = "float32") -> None:
        """`network`: folded (see `fold_norms`)."""
        self.name = "torch" if numerics == "float32" else f"torch-{numerics}"
        self.numerics: Numerics = numerics
        self._config = config
        self._network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def encode(self, points: Floats) -> Tensor:
        """See `Backend.encode`."""
        with torch.inference_mode(), self._precision():
            # torch refuses arrays that cannot be written to, as scans are.
            pillars = pillarise([torch.from_numpy(points.copy())], self._config)
            features: Tensor = self._network.encoder(pillars)[0]
            return features.float()

    def decode(self, fused: Tensor, wanted: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Backend.decode`."""
        with torch.inference_mode(), self._precision():
            one = fused[None].contiguous(memory_format=torch.channels_last)
            heat, channels = self._network.decoder(one)
            return heat[0].float(), channels[0].float()

    def _precision(self) -> torch.autocast:
        return torch.autocast("cpu", torch.bfloat16, enabled=self.numerics == "bfloat16")


class CompiledBackend:
    """The network in C."""

    name = "compiled"
    numerics: Numerics = "float32"

    def __init__(self, network: Network, config: BevConfig) -> None:
        """`network`: folded (see `fold_norms`). Raises PerceptionError where nothing could be
        compiled."""
        compiled = library.network()
        if compiled is None:
            raise PerceptionError(
                "the detector's loops in C are not there: perception was installed without a "
                "compiler"
            )
        # PyTorch's number of threads is that of OMP_NUM_THREADS, or of the processors.
        workers = Workers(compiled, torch.get_num_threads())
        self._encoder = CompiledEncoder(network.encoder, config, workers)
        self._decoder = CompiledDecoder(network.decoder, workers)

    def encode(self, points: Floats) -> Tensor:
        """See `Backend.encode`."""
        return self._encoder(points)

    def decode(self, fused: Tensor, wanted: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Backend.decode`."""
        where = None if wanted is None else wanted.numpy()
        return self._decoder(fused.permute(1, 2, 0).contiguous().numpy(), where)


def choose(network: Network, config: BevConfig, wanted: str | None = None) -> Backend:
    """The cheapest backend on this machine, or the one that is wanted by name; the environment's
    (SETTING) when None.

    Raises PerceptionError for an unknown one, or one that cannot run here.
    """
    wanted = wanted or os.environ.get(SETTING) or AUTO
    fold_norms(network)
    exact = TorchBackend(network, config)
    if wanted == exact.name:
        return exact
    if wanted == CompiledBackend.name:
        return CompiledBackend(network, config)
    if wanted == "torch-bfloat16":
        return _in_bfloat16(network, config)
    if wanted != AUTO:
        raise PerceptionError(
            f"{SETTING} = {wanted!r} is not valid; allowed: auto, torch, compiled, torch-bfloat16"
        )
    candidates: list[Backend] = []
    if library.network() is not None:
        candidates.append(CompiledBackend(network, config))
    if "avx512_bf16" in library.processor_flags():
        candidates.append(_in_bfloat16(network, config))
    return _cheapest(exact, candidates, config)


def fold_norms(network: Network) -> None:
    """Puts batch norms into the layers before them: the same result in half of the passes."""
    for module in list(network.modules()):
        if not isinstance(module, nn.Sequential):
            continue
        for i in range(len(module) - 1):
            layer, norm = module[i], module[i + 1]
            if isinstance(layer, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                module[i], module[i + 1] = fuse_conv_bn_eval(layer, norm), nn.Identity()
            elif isinstance(layer, nn.Linear) and isinstance(norm, nn.BatchNorm1d):
                module[i], module[i + 1] = fuse_linear_bn_eval(layer, norm), nn.Identity()


def _in_bfloat16(network: Network, config: BevConfig) -> Backend:
    if "amx_tile" in library.processor_flags():
        # Virtual machines announce AMX whose first instruction faults. oneDNN reads this before
        # its first layer; a lower limit that somebody has set stays.
        os.environ.setdefault("ONEDNN_MAX_CPU_ISA", ISA_BELOW_AMX)
    # Of oneDNN itself, and of PyTorch's own layer above it.
    for cache in ("ONEDNN_PRIMITIVE_CACHE_CAPACITY", "LRU_CACHE_CAPACITY"):
        os.environ.setdefault(cache, str(KEPT_KERNELS))
    return TorchBackend(network, config, "bfloat16")


def _cheapest(exact: Backend, candidates: list[Backend], config: BevConfig) -> Backend:
    """Which takes the least of those that say what `exact` says.

    The first stays where others are hardly better: the trial's map says something everywhere, and
    the loops in C gain the most from where nobody has said anything.
    """
    chances = torch.rand(
        (FEATURES, _TRIAL_CELLS, _TRIAL_CELLS), generator=torch.Generator().manual_seed(0)
    )
    half = (config.half_x_m, config.half_y_m, min(-config.low_z_m, config.high_z_m))
    cloud = np.random.default_rng(0).uniform(-1.0, 1.0, (_TRIAL_POINTS, 3)) * half
    threads = torch.get_num_threads()
    # PyTorch's other threads would spin on while the next one is tried.
    torch.set_num_threads(1)
    try:
        points = cloud.astype(np.float32)
        told, features = exact.decode(chances)[0].sigmoid(), exact.encode(points)

        def agrees(backend: Backend) -> bool:
            off = (backend.decode(chances)[0].sigmoid() - told).abs().max()
            # A cell may hold a point on a border, or not.
            encoded = (backend.encode(points) - features).abs().mean()
            return max(float(off), float(encoded)) <= _TOLERANCE[backend.numerics]  # NaN is not.

        backends = [*filter(agrees, candidates), exact]
        costs_s = _costs_s(backends, points, chances)
    finally:
        torch.set_num_threads(threads)
    best = 0
    for i in range(1, len(backends)):
        if costs_s[i] < _BETTER * costs_s[best]:
            best = i
    return backends[best]


def _costs_s(backends: list[Backend], cloud: Floats, fused: Tensor) -> list[float]:
    """Of each, the least processor time of a few tries to encode a cloud and decode a map, of all
    threads together: what is left for everybody else on the machine counts, and whatever these do
    meanwhile hardly does. The tries take turns: all meet the same machine."""
    times: list[list[float]] = [[] for _ in backends]
    for _ in range(_TRIALS):
        for backend, taken in zip(backends, times, strict=True):
            begun = time.process_time()
            backend.encode(cloud)
            backend.decode(fused)
            taken.append(time.process_time() - begun)
    return [min(taken) for taken in times]
