"""OpenCOOD's config.yaml: what is read, what is refused, and that nothing in it runs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from options.opencood.config import OpenCoodConfig, read_config
from swarm.errors import PerceptionError
from tests.support.opencood_models import PUBLISHED, SMALL, settings


def read(tmp_path: Path, text: str) -> OpenCoodConfig:
    (tmp_path / "config.yaml").write_text(text)
    return read_config(tmp_path)


def changed(path: str, value: Any, fusion: str = "Early") -> str:
    """The settings with one value replaced; None takes it away."""
    values = settings(fusion)
    *parents, key = path.split(".")
    section = values
    for parent in parents:
        section = section[parent]
    if value is None:
        del section[key]
    else:
        section[key] = value
    return str(yaml.safe_dump(values))


def test_settings_are_typed(tmp_path: Path) -> None:
    config = read(tmp_path, yaml.safe_dump(settings("Intermediate", compression=2)))
    assert config.core_method == "point_pillar_intermediate"
    assert config.fusion == "intermediate"
    assert config.grid == (128, 64)
    assert config.feature_stride == 2
    assert config.anchor_size == (3.9, 1.6, 1.56)
    assert config.anchor_yaws == (0.0, math.pi / 2)
    assert config.backbone.compression == 2
    assert (config.score_threshold, config.nms_threshold) == (0.2, 0.15)


def test_anchors_and_aliases_of_yaml_are_followed(tmp_path: Path) -> None:
    text = yaml.safe_dump(settings("Late"))
    assert "lidar_range: &" in text
    assert "cav_lidar_range: *" in text
    assert read(tmp_path, text).lidar_range == (-25.6, -12.8, -3, 25.6, 12.8, 1)


def test_arrays_that_the_trainer_left_in_the_file_are_passed_over(tmp_path: Path) -> None:
    values = settings("Early")
    values["model"]["args"]["point_pillar_scatter"]["grid_size"] = np.array([128, 64, 1])
    values["postprocess"]["anchor_args"]["vw"] = np.float64(0.4)
    text = yaml.dump(values)
    assert "!!python/object/apply:numpy" in text
    assert read(tmp_path, text).grid == (128, 64)


def test_an_array_where_a_number_is_needed_is_refused(tmp_path: Path) -> None:
    values = settings("Early")
    values["model"]["args"]["voxel_size"] = np.array([0.4, 0.4, 4])
    with pytest.raises(PerceptionError, match=r"model\.args\.voxel_size is !!python/object"):
        read(tmp_path, yaml.dump(values))


@pytest.mark.parametrize(
    "tag",
    [
        "!!python/object/apply:os.mkdir [ran]",
        "!!python/object/new:pathlib.Path [ran]",
        "!!python/name:os.system ''",
        "!!python/module:os ''",
        "!!python/object:numpyx.Thing {}",
        "!<tag:example.org,2024:thing> 1",
    ],
)
def test_tags_that_ask_for_code_are_refused(
    tmp_path: Path, tag: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(PerceptionError, match="refused"):
        read(tmp_path, yaml.safe_dump(settings("Early")) + f"\nextra: {tag}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["config.yaml"]


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("model.core_method", "point_pillar_where2comm", "point_pillar, point_pillar_interm"),
        ("model.core_method", None, "missing"),
        ("fusion.core_method", "IntermediateFusionDataset", "EarlyFusionDataset, LateFusion"),
        ("fusion.args", {"proj_first": False}, "proj_first is False; allowed: True"),
        ("preprocess.core_method", "BevPreprocessor", "SpVoxelPreprocessor"),
        ("preprocess.args.max_points_per_voxel", 0, "from 1 to 1000"),
        ("preprocess.args.max_voxel_test", 2.5, "a whole number"),
        ("preprocess.args.voxel_size", [0.2, 0.2, 4], "what model.args says"),
        ("preprocess.cav_lidar_range", [0, 1], "6 numbers"),
        ("postprocess.order", "lwh", "hwl"),
        ("postprocess.anchor_args.num", 3, "allowed: 2"),
        ("postprocess.anchor_args.feature_stride", 4, "allowed: 2"),
        ("postprocess.anchor_args.l", float("nan"), "from 0.1 to 100"),
        ("postprocess.target_args.score_threshold", "high", "a number from 0 to 1"),
        ("postprocess", [1], "a mapping"),
        ("model.args.lidar_range", [5, 0, 0, -5, 1, 1], "each larger"),
        ("model.args.voxel_size", [0.4, 0.4, 1], "on one floor"),
        ("model.args.voxel_size", [0.5, 0.5, 4], "multiples of 8"),
        ("model.args.voxel_size", [0.01, 0.01, 4], "up to 4000000"),
        ("model.args.pillar_vfe.num_filters", [64, 64], "1 numbers"),
        ("model.args.pillar_vfe.with_distance", True, "False"),
        ("model.args.point_pillar_scatter.num_features", 32, "allowed: 64"),
        ("model.args.base_bev_backbone.layer_nums", [10**9, 1, 1], "from 0 to 64"),
        ("model.args.base_bev_backbone.upsample_strides", [1, 1, 1], "one resolution"),
        ("model.args.base_bev_backbone.num_filters", [16, True, 32], "3 numbers"),
    ],
)
def test_a_setting_that_is_not_allowed_is_named(
    tmp_path: Path, path: str, value: Any, message: str
) -> None:
    with pytest.raises(PerceptionError, match=message):
        read(tmp_path, changed(path, value))


@pytest.mark.parametrize(
    ("compression", "backbone", "message"),
    [(6, PUBLISHED, "multiples of 128"), (5, SMALL, "halve 16 channels")],
)
def test_compression_must_halve_the_map_without_rest(
    tmp_path: Path, compression: int, backbone: dict[str, Any], message: str
) -> None:
    with pytest.raises(PerceptionError, match=message):
        read(tmp_path, yaml.safe_dump(settings("Intermediate", compression, **backbone)))


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "a: 2024-13-45", "\x00", "x" * 1_000_001])
def test_a_file_that_is_no_configuration_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(PerceptionError, match=r"config\.yaml"):
        read(tmp_path, text)


def test_a_directory_without_configuration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PerceptionError, match=r"config\.yaml cannot be read"):
        read_config(tmp_path)
