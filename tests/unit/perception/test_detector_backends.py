"""Whatever runs the network, and on whatever processor: the same boxes."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import torch

from perception.boxes import iou_bev
from perception.codec.features import decode_cells
from perception.codec.outlined import take_outline
from perception.detector import backends, pillars
from perception.detector.backends import CompiledBackend, TorchBackend, choose, fold_norms
from perception.detector.grid import BevConfig, bev_config
from perception.detector.learned import Detector
from perception.detector.network import Network
from perception.detector.weights import load_weights
from perception.fusion.base import Contribution, EncodeOptions
from perception.fusion.registry import make_fusion
from perception.kernels import library
from perception.kernels.convolution import Convolution, Floats, Workers
from perception.types import Boxes
from swarm.errors import PerceptionError
from tests.support.tiny_detector import TINY, random_cloud, random_network, tiny
from worlds.factory.world import FactoryWorld

__all__ = ["tiny"]

needs_compiled = pytest.mark.skipif(
    library.network() is None, reason="perception was installed without a compiler"
)


def folded(seed: int = 0, config: BevConfig = TINY) -> Network:
    network = random_network(config, seed)
    fold_norms(network)
    return network


@pytest.fixture
def every_build() -> list[ctypes.CDLL]:
    """Those of the builds of network.c that this processor can run."""
    flags = library.processor_flags()
    names = [name for name, needed in library._NEEDED.items() if needed <= flags]
    found = [
        library.load(library._FOLDER, name, library._VERSION, library._NETWORK) for name in names
    ]
    assert found
    return [build for build in found if build is not None]


@needs_compiled
@pytest.mark.parametrize("size", [(1, 1), (3, 5), (4, 4), (6, 9), (50, 22)])
@pytest.mark.parametrize(
    ("before", "after", "kernel", "stride"),
    [(32, 48, 3, 1), (96, 64, 3, 1), (48, 96, 3, 2), (64, 12, 1, 1)],
)
def test_a_convolution_in_c_is_that_of_pytorch(
    every_build: list[ctypes.CDLL],
    size: tuple[int, int],
    before: int,
    after: int,
    kernel: int,
    stride: int,
) -> None:
    torch.manual_seed(1)
    image = torch.randn(*size, before)
    weights, bias = torch.randn(after, before, kernel, kernel) / before, torch.randn(after)
    wanted = torch.nn.functional.conv2d(
        image.permute(2, 0, 1)[None], weights, bias, stride, kernel // 2
    )[0].permute(1, 2, 0)
    for build in every_build:
        for threads in (1, 3):
            layer = Convolution(
                Workers(build, threads), weights.numpy(), bias.numpy(), stride, relu=False
            )
            # Part of the channels of a wider image, whose others stay as they are.
            wide = np.full((*wanted.shape[:2], layer.after + 16), 7.0, np.float32)
            layer(image.numpy(), wide[..., : layer.after])
            np.testing.assert_allclose(wide[..., :after], wanted.numpy(), atol=2e-5)
            assert (wide[..., layer.after :] == 7.0).all()


@needs_compiled
@pytest.mark.parametrize("count", [0, 1, 30, 5000])
@pytest.mark.parametrize("seed", [0, 3])
def test_the_network_in_c_is_that_in_pytorch(
    tiny: BevConfig,
    every_build: list[ctypes.CDLL],
    count: int,
    seed: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    network = folded(seed)
    exact = TorchBackend(network, tiny)
    cloud = random_cloud(count=count, seed=seed).numpy()
    cloud[: count // 10] = np.nan
    cloud[count // 10 : count // 5] *= 3
    features = exact.encode(cloud)
    heat, channels = exact.decode(features)
    for build in every_build:
        monkeypatch.setattr(library, "network", lambda build=build: build)
        compiled = CompiledBackend(network, tiny)
        ours = compiled.encode(cloud)
        assert ours.shape == features.shape
        assert ours.dtype == features.dtype
        assert torch.allclose(ours, features, atol=1e-4)
        heat_ours, channels_ours = compiled.decode(features)
        assert torch.allclose(heat_ours, heat, atol=1e-4)
        assert torch.allclose(channels_ours, channels, atol=1e-4)


@needs_compiled
@pytest.mark.parametrize("name", ["factory", "road"])
def test_the_boxes_in_c_are_those_in_pytorch(name: str) -> None:
    cloud = random_cloud(bev_config(name), 20_000, seed=2).numpy()
    exact, compiled = (Detector(name, backend=backend) for backend in ("torch", "compiled"))
    a, b = exact.detect(cloud), compiled.detect(cloud)
    assert len(a) == len(b) > 0
    np.testing.assert_allclose(a.scores, b.scores, atol=1e-4)
    np.testing.assert_allclose(a.centers, b.centers, atol=1e-3)


@needs_compiled
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [(24, 32), (50, 34), (128, 128)])
def test_where_nobody_asks_less_is_computed_and_elsewhere_nothing_changes(
    tiny: BevConfig, seed: int, size: tuple[int, int]
) -> None:
    compiled = CompiledBackend(folded(seed), tiny)
    torch.manual_seed(seed)
    fused = torch.rand(32, *size)
    wanted = torch.zeros(size, dtype=torch.bool)
    wanted[torch.randint(size[0], (3,)), torch.randint(size[1], (3,))] = True
    heat, channels = compiled.decode(fused)
    sparse_heat, sparse_channels = compiled.decode(fused, wanted)
    # Up to rounding: a tile's sums hold what they cancel again.
    assert torch.allclose(sparse_heat[:, wanted], heat[:, wanted], atol=1e-5)
    assert torch.allclose(sparse_channels[:, wanted], channels[:, wanted], atol=1e-5)
    assert sparse_heat.isfinite().all()
    if size == (128, 128):
        assert not torch.equal(sparse_heat, heat)


@needs_compiled
def test_more_points_than_a_cloud_may_have_are_thinned_in_c_as_in_pytorch(
    tiny: BevConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pillars, "MAX_POINTS", 700)
    network, cloud = folded(), random_cloud(count=3000).numpy()
    exact, compiled = TorchBackend(network, tiny), CompiledBackend(network, tiny)
    assert torch.allclose(exact.encode(cloud), compiled.encode(cloud), atol=1e-4)


@pytest.mark.parametrize("name", ["factory", "road"])
def test_chances_in_bfloat16_are_near_those_in_float32(name: str) -> None:
    weights = load_weights(name)
    fold_norms(weights.network)
    exact = TorchBackend(weights.network, weights.config)
    short = TorchBackend(weights.network, weights.config, "bfloat16")
    cloud = random_cloud(weights.config, 20_000, seed=2).numpy()
    features, rounded = exact.encode(cloud), short.encode(cloud)
    assert rounded.dtype == torch.float32
    assert 0.0 < (features - rounded).abs().max() < 0.2
    assert (features - rounded).abs().mean() < 2e-3
    assert torch.equal(features > 0, features > 0)
    off = exact.decode(features)[0].sigmoid() - short.decode(features)[0].sigmoid()
    assert 0.0 < off.abs().max() < 0.03


def test_without_a_compiler_pytorch_does_it(
    tiny: BevConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "network", lambda: None)
    monkeypatch.setattr(library, "processor_flags", lambda: frozenset({"avx2"}))
    assert choose(random_network(), tiny).name == "torch"
    with pytest.raises(PerceptionError, match="without a compiler"):
        choose(random_network(), tiny, "compiled")


@needs_compiled
def test_frames_that_are_decoded_at_once_do_not_disturb_each_other() -> None:
    build = library.network()
    assert build is not None
    workers = Workers(build, 3)
    generator = np.random.default_rng(0)
    weights = generator.standard_normal((32, 32, 3, 3)).astype(np.float32)
    layer = Convolution(workers, weights, np.zeros(32, np.float32))
    images = [generator.standard_normal((44, 44, 32)).astype(np.float32) for _ in range(4)]
    alone = [np.empty_like(image) for image in images]
    for image, out in zip(images, alone, strict=True):
        layer(image, out)

    def many(image: Floats, expected: Floats) -> bool:
        out = np.empty_like(image)
        for _ in range(200):
            out.fill(np.nan)
            layer(image, out)
            if not np.array_equal(out, expected):
                return False
        return True

    with ThreadPoolExecutor(len(images)) as pool:
        assert all(pool.map(many, images, alone))


@needs_compiled
def test_a_networks_threads_end_with_it() -> None:
    build = library.network()
    assert build is not None
    before = set(os.listdir("/proc/self/task"))
    workers = Workers(build, 4)
    assert len(set(os.listdir("/proc/self/task")) - before) == 3
    del workers
    end = time.monotonic() + 30.0
    while not set(os.listdir("/proc/self/task")) <= before:
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize("broken", ["slow", "wrong", "not a number"])
def test_what_is_slower_or_wrong_is_not_taken(
    tiny: BevConfig, monkeypatch: pytest.MonkeyPatch, broken: str
) -> None:
    network = folded()

    class Broken(TorchBackend):
        name = "broken"

        def decode(  # type: ignore[override]
            self, fused: torch.Tensor
        ) -> tuple[torch.Tensor, torch.Tensor]:
            heat, channels = super().decode(fused)
            wrong = {"slow": 0.0, "wrong": 0.5, "not a number": np.nan}[broken]
            return heat + wrong, channels

    seconds = {"torch": 1.0, "broken": 1.2 if broken == "slow" else 0.1}
    monkeypatch.setattr(
        backends, "_costs_s", lambda tried, *_: [seconds[backend.name] for backend in tried]
    )
    exact, other = TorchBackend(network, tiny), Broken(network, tiny)
    other.name = "broken"
    assert backends._cheapest(exact, [other], tiny) is exact  # type: ignore[list-item]


def test_bfloat16_is_tried_only_where_the_processor_has_it(
    tiny: BevConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ONEDNN_MAX_CPU_ISA", raising=False)
    tried: list[str] = []

    def cheapest(
        exact: backends.Backend, candidates: list[backends.Backend], config: BevConfig
    ) -> backends.Backend:
        tried.extend(candidate.name for candidate in candidates)
        return exact

    monkeypatch.setattr(backends, "_cheapest", cheapest)
    monkeypatch.setattr(library, "network", lambda: None)
    for flags in (set(), {"avx2", "fma"}, {"amx_tile", "amx_bf16"}):
        monkeypatch.setattr(library, "processor_flags", lambda flags=flags: frozenset(flags))
        choose(random_network(), tiny)
    assert tried == []
    monkeypatch.setattr(library, "processor_flags", lambda: frozenset({"avx512_bf16"}))
    choose(random_network(), tiny)
    assert tried == ["torch-bfloat16"]


def test_amx_that_may_fault_is_never_tried() -> None:
    # oneDNN reads the limit before its first layer, so it holds though torch is loaded: shown with
    # a limit that every processor is above.
    code = """
import os, torch
from perception.detector import backends
from perception.detector.grid import bev_config
from perception.detector.network import FEATURES, Network
from perception.kernels import library
library.processor_flags = lambda: frozenset({"avx512_bf16", "amx_tile"})
network, config = Network(bev_config("factory")).eval(), bev_config("factory")
assert backends.ISA_BELOW_AMX == "AVX512_CORE_BF16"
backends.ISA_BELOW_AMX = "SSE41"
print(backends.choose(network, config, "torch-bfloat16").name)
backends.choose(network, config, "torch").decode(torch.rand(FEATURES, 16, 16))
"""
    environment = {key: value for key, value in os.environ.items() if "ISA" not in key}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**environment, "ONEDNN_VERBOSE": "1"},
    )
    assert "torch-bfloat16" in done.stdout
    [isa] = [line for line in done.stdout.splitlines() if "cpu,isa" in line]
    assert "SSE4.1" in isa


def test_kernels_of_shapes_that_do_not_come_again_are_not_kept() -> None:
    # Every size is decoded twice: a kernel that is built twice was not kept in between.
    code = """
import torch
from perception.detector import backends
from perception.detector.grid import bev_config
from perception.detector.network import FEATURES, Network
network, config = Network(bev_config("factory")).eval(), bev_config("factory")
backends.choose(network, config, "torch-bfloat16")
exact = backends.choose(network, config, "torch")
for _ in range(2):
    for size in range(8, 8 + 2 * backends.KEPT_KERNELS, 2):
        exact.decode(torch.rand(FEATURES, size, size))
"""
    environment = {key: value for key, value in os.environ.items() if "ONEDNN" not in key}

    def built_again(**more: str) -> int:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            env={**environment, "ONEDNN_VERBOSE": "2", **more},
        )
        built = [line for line in done.stdout.splitlines() if "create:cache_miss" in line]
        assert built
        # The last field is how long it took.
        times = Counter(line.partition("create:cache_miss")[2].rpartition(",")[0] for line in built)
        return sum(count > 1 for count in times.values())

    assert built_again() > 0
    assert built_again(ONEDNN_PRIMITIVE_CACHE_CAPACITY="1024") == 0, "what somebody has set stays"


def test_memory_does_not_grow_with_clouds_of_ever_other_sizes() -> None:
    code = """
import numpy as np, torch
from pathlib import Path
from perception.detector import backends
from perception.detector.grid import bev_config
from perception.detector.network import Network
from swarm.memory import keep_freed_memory
keep_freed_memory()
torch.set_num_threads(1)
chance = np.random.default_rng(0)
backend = backends.choose(
    Network(bev_config("factory")).eval(), bev_config("factory"), "torch-bfloat16"
)
def encode(times):
    for _ in range(times):
        backend.encode(chance.uniform(-30, 30, (chance.integers(3000, 9000), 3)).astype("float32"))
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096
before = encode(100)
print(encode(300) - before)
"""
    environment = {k: v for k, v in os.environ.items() if "CACHE_CAPACITY" not in k}
    grown = subprocess.check_output([sys.executable, "-c", code], text=True, env=environment)
    assert int(grown) < 30_000_000, "some 60 MB where either cache keeps everything"


def test_the_setting_forces_a_backend_and_an_unknown_one_is_refused(
    tiny: BevConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(backends.SETTING, "torch")
    assert choose(random_network(), tiny).name == "torch"
    monkeypatch.setenv(backends.SETTING, "abacus")
    with pytest.raises(PerceptionError, match="'abacus' is not valid; allowed: auto, torch"):
        choose(random_network(), tiny)


@pytest.mark.parametrize("algorithm", ["intermediate", "intermediate-codebook"])
@pytest.mark.parametrize(
    ("robots", "egos"), [("torch-bfloat16", "torch"), ("torch", "torch-bfloat16")]
)
def test_a_robot_and_an_ego_of_other_numerics_fuse_as_two_of_one_kind(
    algorithm: str, robots: str, egos: str
) -> None:
    world = FactoryWorld(robots=4, seed=1_000_003)
    ego, robot = world.scan("R1", 120), world.scan("R2", 120)
    kind: Any = type(make_fusion(algorithm, "factory"))

    def found(robot_backend: str, ego_backend: str) -> Boxes:
        sender, receiver = (
            kind(Detector("factory", backend=name)) for name in (robot_backend, ego_backend)
        )
        options = EncodeOptions(pose=robot.pose, reference=ego.pose)
        payload = sender.encode(robot.points, options)
        block = decode_cells(take_outline(payload)[0], sender.detector.version, (128, 128), 32, 8)
        assert block.numerics == ("bfloat16" if "bfloat16" in robot_backend else "float32")
        sent = Contribution("R2", payload, robot.pose.matrix())
        fused = receiver.fuse(ego.points, ego.pose.matrix(), [sent])
        assert fused.rejected == {}
        return fused.boxes

    alike, mixed = found("torch", "torch"), found(robots, egos)
    sure = alike.take(alike.scores > 0.3)
    assert len(sure)
    overlap = iou_bev(sure, mixed)
    assert (overlap.max(axis=1) > 0.8).all()
    scores = mixed.scores[overlap.argmax(axis=1)]
    np.testing.assert_allclose(scores, sure.scores, atol=0.05)
