"""Weights on disk: what is read back, and what is refused with which words."""

from __future__ import annotations

import json
import pickle
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from safetensors.torch import save_file

from perception.detector.backends import TorchBackend, fold_norms
from perception.detector.learned import Detector
from perception.detector.network import Network
from perception.detector.pillars import pillarise
from perception.detector.weight_files import has_weights, weight_file
from perception.detector.weights import ARCHITECTURE, load_weights, save_weights
from swarm.errors import PerceptionError
from tests.support.tiny_detector import TINY, random_cloud, random_codebook, random_network, tiny  # noqa: F401

pytestmark = pytest.mark.usefixtures("tiny")
Tensors = dict[str, torch.Tensor]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "folder" / "tiny.safetensors"


def write(path: Path, network: Network | None = None, **facts: str) -> Path:
    save_weights(path, "tiny", (network or random_network()).state_dict(), random_codebook(), facts)
    return path


def raw(
    path: Path, change: dict[str, torch.Tensor | None] | None = None, **facts: str
) -> tuple[str, Path]:
    """A file written by hand: some tensors changed (None: left out), some facts changed."""
    tensors: dict[str, Any] = {k: v.clone() for k, v in random_network().state_dict().items()}
    tensors["codebook"] = torch.from_numpy(random_codebook())
    tensors.update(change or {})
    known = {"architecture": ARCHITECTURE, "config": "tiny", **facts}
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = {k: v for k, v in tensors.items() if v is not None}
    save_file(kept, path, metadata={"facts": json.dumps(known)})
    return str(path), path


def test_what_is_saved_is_loaded(path: Path) -> None:
    network = random_network()
    loaded = load_weights("tiny", write(path, network, seed="7"))
    assert loaded.config is TINY
    assert np.array_equal(loaded.codebook, random_codebook())
    assert not loaded.network.training
    saved, read = network.state_dict(), loaded.network.state_dict()
    assert saved.keys() == read.keys()
    assert all(torch.equal(saved[key], read[key]) for key in saved)


def test_the_same_weights_are_the_same_file_and_version(path: Path) -> None:
    facts: dict[str, Any] = {"steps": "4", "seed": "1", "batch": "2"}
    assert len({write(path, **facts).read_bytes() for _ in range(5)}) == 1
    version = load_weights("tiny", path).version
    assert version == load_weights("tiny", write(path, **facts)).version
    assert 0 <= version < 1 << 32


def test_the_version_differs_when_one_weight_differs(path: Path, tmp_path: Path) -> None:
    network = random_network()
    before = load_weights("tiny", write(path, network)).version
    with torch.no_grad():
        next(network.parameters()).view(-1)[0] += 1e-3
    assert load_weights("tiny", write(tmp_path / "other.safetensors", network)).version != before


def test_folded_norms_say_the_same_as_the_network(path: Path) -> None:
    network = random_network(seed=4)
    folded_network = load_weights("tiny", write(path, network)).network
    fold_norms(folded_network)
    detector = TorchBackend(folded_network, TINY)
    cloud = random_cloud(count=3000, seed=4)
    with torch.inference_mode():
        maps = network.encoder(pillarise([cloud], TINY))
        heat, channels = network.decoder(maps)
        folded = detector.encode(cloud.numpy())
        heat_folded, channels_folded = detector.decode(folded)
    assert maps.std() > 0.05
    assert torch.allclose(folded, maps[0], atol=1e-4)
    assert torch.allclose(heat_folded, heat[0], atol=1e-4)
    assert torch.allclose(channels_folded, channels[0], atol=1e-4)
    norms = (torch.nn.BatchNorm1d, torch.nn.BatchNorm2d)
    assert not any(isinstance(part, norms) for part in folded_network.modules())


def test_maps_are_between_zero_and_one_and_views_are_chances(path: Path) -> None:
    detector = Detector("tiny", write(path))
    features = detector.encode(random_cloud().numpy())
    assert features.shape == (32, *TINY.cells)
    assert features.min() >= 0.0
    assert features.max() <= 1.0
    seen = detector.look(features)
    assert seen.shape == (3, *TINY.cells)
    assert ((seen[0] >= 0) & (seen[0] <= 1)).all()


def test_scans_that_cannot_be_written_to_are_read(path: Path) -> None:
    cloud = random_cloud().numpy()
    cloud.setflags(write=False)
    detector = Detector("tiny", write(path))
    assert torch.equal(detector.encode(cloud), detector.encode(cloud.copy()))


def refusal(path: Path, name: str = "tiny") -> str:
    with pytest.raises(PerceptionError) as caught:
        load_weights(name, path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_a_missing_file_is_named_with_what_makes_it(path: Path) -> None:
    assert "make train CONFIG=tiny" in refusal(path)


def test_a_folder_is_no_weights_file(tmp_path: Path) -> None:
    refusal(tmp_path)


def test_an_unknown_configuration_is_refused(path: Path) -> None:
    with pytest.raises(PerceptionError, match=r"'sea' is not known; allowed: factory, road"):
        load_weights("sea", path)


def test_weights_of_another_architecture_are_refused(path: Path) -> None:
    raw(path, architecture="pillars-0")
    text = refusal(path)
    assert "'pillars-0'" in text
    assert f"'{ARCHITECTURE}' is needed" in text


def test_weights_of_another_configuration_are_refused(path: Path) -> None:
    write(path)
    text = refusal(path, "factory")
    assert "'tiny'" in text
    assert "'factory' is needed" in text


def test_tensors_that_do_not_say_what_they_are_for_are_refused(path: Path) -> None:
    path.parent.mkdir()
    save_file(random_network().state_dict(), path)
    assert f"'{ARCHITECTURE}' is needed" in refusal(path)


@pytest.mark.parametrize("key", ["codebook", "decoder.heat.weight"])
def test_a_missing_tensor_is_named(path: Path, key: str) -> None:
    raw(path, {key: None})
    assert key in refusal(path)


def test_a_tensor_too_many_is_named(path: Path) -> None:
    raw(path, {"surplus": torch.zeros(3)})
    assert "surplus" in refusal(path)


def test_a_tensor_of_another_shape_is_named(path: Path) -> None:
    raw(path, {"decoder.heat.bias": torch.zeros(5)})
    assert "decoder.heat.bias" in refusal(path)


@pytest.mark.parametrize(
    "codebook",
    [
        np.zeros((8, 256, 9), np.float32),
        np.zeros((8, 100, 4), np.float32),
        np.zeros((4, 256, 8), np.float32),
        np.zeros(7, np.float32),
    ],
    ids=["wide", "short", "parts", "flat"],
)
def test_a_codebook_that_does_not_fit_the_features_is_refused(
    path: Path, codebook: NDArray[np.float32]
) -> None:
    raw(path, {"codebook": torch.from_numpy(codebook)})
    assert "codebook" in refusal(path)


@pytest.mark.parametrize("key", ["decoder.boxes.bias", "codebook"])
def test_weights_that_are_no_numbers_are_refused(path: Path, key: str) -> None:
    tensors = {**random_network().state_dict(), "codebook": torch.from_numpy(random_codebook())}
    bad = tensors[key].clone()
    bad.view(-1)[0] = float("nan")
    raw(path, {key: bad})
    assert key in refusal(path)


@pytest.mark.parametrize("share", [0.0, 0.00001, 0.01, 0.5, 0.999])
def test_a_truncated_file_is_refused(path: Path, share: float) -> None:
    whole = write(path).read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    assert "not a safetensors file" in refusal(path)


class Bomb:
    """What must not be unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (pytest.fail, ("a weights file was unpickled",))


def test_a_pickle_is_refused_unread(path: Path) -> None:
    path.parent.mkdir()
    path.write_bytes(pickle.dumps(Bomb()))
    assert "not a safetensors file" in refusal(path)
    torch.save(random_network().state_dict(), path)
    assert "not a safetensors file" in refusal(path)


def test_a_header_that_lies_about_its_length_is_refused(path: Path) -> None:
    header = json.dumps({"x": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}).encode()
    path.parent.mkdir()
    path.write_bytes(struct.pack("<Q", 1 << 60) + header + bytes(8))
    assert "not a safetensors file" in refusal(path)


def test_a_file_above_the_allowed_size_is_refused(path: Path) -> None:
    raw(path, {"decoder.heat.bias": torch.zeros(3_000_000)})
    assert path.stat().st_size > 8_000_000
    assert "8000000" in refusal(path).replace(",", "").replace("_", "")


def test_weights_above_the_allowed_size_are_not_written(path: Path) -> None:
    tensors = {"much": torch.zeros(2_000_001)}
    with pytest.raises(PerceptionError, match="allowed: 8000000"):
        save_weights(path, "tiny", tensors, random_codebook(), {})
    assert not path.exists()


def test_weights_lie_where_their_name_says() -> None:
    assert weight_file("tiny").name == "tiny.safetensors"
    assert not has_weights("tiny")
