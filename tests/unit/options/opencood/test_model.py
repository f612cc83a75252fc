"""OpenCOOD models from their directory: what they take, what they refuse, what they find."""

from __future__ import annotations

import dataclasses
import pickle
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from options.opencood.anchors import best, decode
from options.opencood.clouds import mirrored, network_cloud
from options.opencood.model import OpenCoodModel, load
from options.opencood.pillars import sort_into_pillars
from perception.types import Boxes
from swarm.errors import PerceptionError, ScanError
from swarm.geometry import Pose
from tests.support.opencood_models import padded_voxels, scan, settings, write_model
from worlds.opv2v import carla


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp("early"), settings("Early"))


@pytest.fixture(scope="module")
def model(directory: Path) -> OpenCoodModel:
    return load(directory)


def same(a: Boxes, b: Boxes) -> bool:
    return (
        len(a) == len(b) > 0
        and np.allclose(a.centers, b.centers, atol=1e-4)
        and np.allclose(a.sizes, b.sizes, atol=1e-4)
        and np.allclose(np.sin(a.headings - b.headings), 0, atol=1e-4)
        and np.allclose(a.scores, b.scores, atol=1e-4)
    )


def state_of(directory: Path) -> dict[str, torch.Tensor]:
    state: dict[str, torch.Tensor] = torch.load(directory / "net_epoch7.pth", weights_only=True)
    return state


def with_file(tmp_path: Path, data: bytes) -> Path:
    write_model(tmp_path, settings("Early"))
    (tmp_path / "net_epoch7.pth").write_bytes(data)
    return tmp_path


def with_state(tmp_path: Path, state: object) -> Path:
    write_model(tmp_path, settings("Early"))
    torch.save(state, tmp_path / "net_epoch7.pth")
    return tmp_path


# Checkpoints


def test_a_loaded_model_has_the_weights_of_its_file(directory: Path) -> None:
    loaded = load(directory).network.state_dict()
    for name, value in state_of(directory).items():
        assert torch.equal(loaded[name], value), name


def test_the_latest_then_the_best_then_the_last_checkpoint_is_taken(tmp_path: Path) -> None:
    write_model(tmp_path, settings("Early"), seed=7)
    seven = load(tmp_path).version

    def version(name: str, seed: int) -> int:
        other = write_model(tmp_path / name, settings("Early"), seed)
        (other / "net_epoch7.pth").rename(tmp_path / f"{name}.pth")
        return load(tmp_path).version

    last, early = version("net_epoch12", 12), version("net_epoch3", 3)
    assert len({seven, last}) == 2
    assert early == last
    best = version("net_epoch_bestval_at5", 5)
    latest = version("latest", 99)
    assert len({last, best, latest}) == 3
    assert load(tmp_path, epoch=7).version == seven
    assert load(tmp_path, epoch=5).version == best
    with pytest.raises(PerceptionError, match=r"net_epoch4\.pth"):
        load(tmp_path, epoch=4)


def test_keys_that_do_not_fit_are_named(tmp_path: Path, directory: Path) -> None:
    missing = state_of(directory)
    del missing["cls_head.weight"]
    with pytest.raises(PerceptionError, match=r"cls_head\.weight is missing"):
        load(with_state(tmp_path, missing))
    extra = state_of(directory) | {f"shrink_conv.{i}": torch.zeros(1) for i in range(9)}
    with pytest.raises(PerceptionError, match=r"shrink_conv\.0 is not expected.*and 6 more"):
        load(with_state(tmp_path, extra))
    misshaped = state_of(directory) | {"cls_head.bias": torch.zeros(3)}
    with pytest.raises(PerceptionError, match=r"cls_head\.bias has shape \(3,\), expected \(2,\)"):
        load(with_state(tmp_path, misshaped))
    infinite = state_of(directory) | {"cls_head.bias": torch.tensor([0.0, torch.nan])}
    with pytest.raises(PerceptionError, match=r"cls_head\.bias has numbers that are not finite"):
        load(with_state(tmp_path, infinite))


def test_weights_of_the_other_model_are_refused(tmp_path: Path, directory: Path) -> None:
    write_model(tmp_path, settings("Intermediate", compression=1))
    torch.save(state_of(directory), tmp_path / "net_epoch7.pth")
    with pytest.raises(PerceptionError, match=r"compression_modules.* is missing"):
        load(tmp_path)


@pytest.mark.parametrize("keep", [0, 3, 1000, 0.5, 0.99])
def test_a_truncated_checkpoint_is_refused(tmp_path: Path, directory: Path, keep: float) -> None:
    data = (directory / "net_epoch7.pth").read_bytes()
    length = keep if isinstance(keep, int) else int(len(data) * keep)
    with pytest.raises(PerceptionError, match=r"net_epoch7\.pth"):
        load(with_file(tmp_path, data[:length]))


@pytest.mark.parametrize("data", [b"no checkpoint", b"PK\x03\x04" + bytes(100), bytes(5000)])
def test_a_file_that_is_no_checkpoint_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(PerceptionError, match=r"net_epoch7\.pth"):
        load(with_file(tmp_path, data))


@pytest.mark.parametrize("state", [[1, 2], {"epoch": 3}, torch.zeros(2)])
def test_a_file_without_a_state_dict_is_refused(tmp_path: Path, state: object) -> None:
    with pytest.raises(PerceptionError, match="no state dict"):
        load(with_state(tmp_path, state))


class Payload:
    """Makes a file where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.mark,)


@pytest.mark.parametrize("packed", ["pickle", "torch", "torch-legacy"])
def test_code_in_a_checkpoint_never_runs(tmp_path: Path, packed: str) -> None:
    mark = tmp_path / "ran"
    attack = {"cls_head.weight": Payload(mark)}
    model = write_model(tmp_path / "model", settings("Early")) / "net_epoch7.pth"
    if packed == "pickle":
        model.write_bytes(pickle.dumps(attack, protocol=2))
    else:
        torch.save(attack, model, _use_new_zipfile_serialization=packed == "torch")
    with pytest.raises(PerceptionError, match="more than tensors"):
        load(tmp_path / "model")
    assert not mark.exists()
    # Where pickles are trusted, the same file does run it.
    if packed == "pickle":
        pickle.loads(model.read_bytes())
    else:
        torch.load(model, weights_only=False)
    assert mark.exists()


# Scans


@pytest.mark.parametrize("limit", [70_000, 40])
def test_pillars_are_those_of_a_voxel_generator(model: OpenCoodModel, limit: int) -> None:
    config = dataclasses.replace(model.config, max_voxels=limit)
    cloud = np.concatenate(list(network_cloud(scan(3))))
    cloud = np.concatenate([cloud, np.tile(cloud[:50], (40, 1))])
    pillars = sort_into_pillars(np.array_split(cloud, 7), config)
    padded, cells, counts = padded_voxels(cloud, config)
    assert len(counts) <= limit
    assert counts.max() == config.max_points
    np.testing.assert_array_equal(pillars.cells, cells[:, [2, 1]])
    np.testing.assert_array_equal(np.bincount(pillars.pillar), counts)
    for number in range(len(counts)):
        own = pillars.points[pillars.pillar == number]
        np.testing.assert_array_equal(own, padded[number, : counts[number]])


def test_a_cloud_without_a_point_in_range_shows_nothing(model: OpenCoodModel) -> None:
    far = np.full((10, 3), 3e38, dtype=np.float32)
    for points in (np.zeros((0, 3), np.float32), far, -far, np.full((5, 3), np.nan, np.float32)):
        assert len(model.detect([(points, None)])) == 0


def test_points_that_are_not_finite_change_nothing(model: OpenCoodModel) -> None:
    points = scan(1)
    holes = np.insert(points, [5, 900, 900], [[np.nan] * 3, [np.inf, 0, 0], [0, -np.inf, 0]], 0)
    assert same(model.detect([(holes.astype(np.float32), None)]), model.detect([(points, None)]))


def test_a_cloud_of_another_shape_is_refused(model: OpenCoodModel) -> None:
    for shape in ((5, 4), (5,), (0, 2)):
        with pytest.raises(ScanError, match=r"\(N, 3\)"):
            model.detect([(np.zeros(shape, np.float32), None)])


def test_ten_million_points_take_bounded_memory(model: OpenCoodModel) -> None:
    points = np.tile(scan(2, 100_000), (100, 1))
    tracemalloc.start()
    try:
        pillars = sort_into_pillars(network_cloud(points), model.config)
        assert tracemalloc.get_traced_memory()[1] < 150e6
    finally:
        tracemalloc.stop()
    assert np.bincount(pillars.pillar).max() == model.config.max_points


def test_intensity_falls_with_the_distance_to_the_sensor_that_saw_the_point() -> None:
    points = np.array([[30.0, 40.0, 0.0]], dtype=np.float32)
    moved = Pose(-25.0, -40.0, 0.0).matrix()
    cloud = np.concatenate(list(network_cloud(points, moved)))
    np.testing.assert_allclose(cloud, [[5.0, 0.0, 0.0, np.exp(-0.2)]], atol=1e-5)


def test_intensity_is_what_opv2v_stored(opv2v_dir: Path) -> None:
    file = min(opv2v_dir.rglob("*.pcd"))
    rows = np.loadtxt(file, skiprows=11, max_rows=20_000)
    # Red of a packed colour holds it, in 255 steps.
    stored = (rows[:, 3].astype(np.float32).view(np.uint32) >> 16 & 255) / 255
    points = rows[:, :3].astype(np.float32)
    points = points[(far := np.abs(points[:, :2]).max(axis=1) > 3)]
    cloud = np.concatenate(list(network_cloud(points)))
    assert np.abs(cloud[:, 3] - stored[far]).max() < 0.6 / 255


def test_the_own_body_is_left_out_wherever_the_cloud_goes() -> None:
    points = np.array([[0.5, 1.0, -1.0], [0.5, 1.2, -1.0]], dtype=np.float32)
    cloud = np.concatenate(list(network_cloud(points, Pose(9, 9, 0).matrix())))
    assert len(cloud) == 1


# Frames


def test_clouds_are_mirrored_for_the_network_and_boxes_back(model: OpenCoodModel) -> None:
    stored = scan(4)  # as a CARLA file holds it, left-handed, and as the network was trained
    stored = stored[np.abs(stored[:, :2]).max(axis=1) > 3]
    intensity = np.exp(-0.004 * np.linalg.norm(stored, axis=1, keepdims=True))
    pillars = sort_into_pillars([np.hstack([stored, intensity]).astype(np.float32)], model.config)
    with torch.inference_mode():
        logits, offsets = model.network.heads([model.network.encode(pillars)])
    left = best(decode(logits.numpy(), offsets.numpy(), model.config), 0.15)
    found = model.detect([(carla.points(stored), None)])
    assert same(found, mirrored(left))
    np.testing.assert_allclose(found.centers, left.centers * [1, -1, 1], atol=1e-4)
    np.testing.assert_allclose(np.sin(found.headings), -np.sin(left.headings), atol=1e-4)
    assert np.abs(found.centers[:, 1]).max() > 1
