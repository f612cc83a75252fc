"""OpenCOOD model directories with random weights, and scans for them."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from numpy.typing import NDArray

from options.opencood.config import OpenCoodConfig, read_config
from options.opencood.network import PointPillarNetwork
from swarm.geometry import Points

RANGE = [-25.6, -12.8, -3, 25.6, 12.8, 1]
SMALL = {"layer_nums": [1, 1, 1], "num_filters": [16, 32, 32]}
PUBLISHED: dict[str, Any] = {"layer_nums": [3, 5, 8], "num_filters": [64, 128, 256]}


def settings(fusion: str = "Early", compression: int = 0, **backbone: Any) -> dict[str, Any]:
    """What a config.yaml says, for a small range."""
    intermediate = fusion == "Intermediate"
    model: dict[str, Any] = {
        "voxel_size": [0.4, 0.4, 4],
        "lidar_range": RANGE,
        "anchor_number": 2,
        "anchor_num": 2,
        "pillar_vfe": {
            "use_norm": True,
            "with_distance": False,
            "use_absolute_xyz": True,
            "num_filters": [64],
        },
        "point_pillar_scatter": {"num_features": 64},
        "base_bev_backbone": {
            "layer_strides": [2, 2, 2],
            "upsample_strides": [1, 2, 4],
            "num_upsample_filter": [128, 128, 128],
            **(backbone or SMALL),
        },
    }
    if intermediate:
        model["base_bev_backbone"]["compression"] = compression
    made: dict[str, Any] = {
        "fusion": {"core_method": f"{fusion}FusionDataset", "args": []},
        "preprocess": {
            "core_method": "SpVoxelPreprocessor",
            "args": {
                "voxel_size": [0.4, 0.4, 4],
                "max_points_per_voxel": 32,
                "max_voxel_test": 70000,
            },
            "cav_lidar_range": RANGE,
        },
        "postprocess": {
            "core_method": "VoxelPostprocessor",
            "anchor_args": {
                "cav_lidar_range": RANGE,
                "l": 3.9,
                "w": 1.6,
                "h": 1.56,
                "r": [0, 90],
                "feature_stride": 2,
                "num": 2,
            },
            "target_args": {"score_threshold": 0.2},
            "order": "hwl",
            "max_num": 100,
            "nms_thresh": 0.15,
        },
        "model": {
            "core_method": "point_pillar_intermediate" if intermediate else "point_pillar",
            "args": model,
        },
    }
    return copy.deepcopy(made)


def random_state(network: torch.nn.Module, seed: int = 0) -> dict[str, torch.Tensor]:
    """Weights and statistics that keep numbers in a detector's usual size."""
    random = torch.Generator().manual_seed(seed)
    state = {}
    for name, value in network.state_dict().items():
        noise = torch.randn(value.shape, generator=random)
        if not value.is_floating_point():
            state[name] = torch.tensor(1000)
        elif name.endswith("running_var") or (name.endswith("weight") and value.ndim == 1):
            state[name] = 0.5 + noise.abs() * 0.5
        elif value.ndim == 1:
            state[name] = noise * 0.2
        else:
            fan_in = value[0].numel()
            state[name] = noise * (1.5 / fan_in) ** 0.5
    state["cls_head.bias"] -= 1.0
    state["reg_head.weight"] *= 0.3
    return state


def write_model(directory: Path, values: dict[str, Any], seed: int = 0) -> Path:
    """A model directory with those settings and random weights, as of epoch 7."""
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "config.yaml").write_text(yaml.safe_dump(values))
    network = PointPillarNetwork(read_config(directory))
    torch.save(random_state(network, seed), directory / "net_epoch7.pth")
    return directory


def scan(seed: int, count: int = 20_000) -> Points:
    """Ground and walls around a sensor, in its frame, dense enough to fill pillars."""
    random = np.random.default_rng(seed)
    radius = random.gamma(2.0, 6.0, count)
    angle = random.uniform(-np.pi, np.pi, count)
    z = np.where(random.random(count) < 0.7, -1.9, random.uniform(-1.9, 1.5, count))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1).astype(np.float32)


def padded_voxels(
    cloud: NDArray[np.float32], config: OpenCoodConfig
) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]]:
    """Point by point what a voxel generator does: voxels (V, 32, 4), cells (z, y, x), counts."""
    low = np.array(config.lidar_range[:3], np.float32)
    high = np.array(config.lidar_range[3:], np.float32)
    cloud = cloud[((cloud[:, :3] > low) & (cloud[:, :3] < high)).all(axis=1)]
    places = np.floor((cloud[:, :3] - low) / np.array(config.voxel_size, np.float32)).astype(int)
    voxels: dict[tuple[int, ...], list[NDArray[np.float32]]] = {}
    for point, place in zip(cloud, map(tuple, places[:, ::-1].tolist()), strict=True):
        if place not in voxels and len(voxels) == config.max_voxels:
            continue
        members = voxels.setdefault(place, [])
        if len(members) < config.max_points:
            members.append(point)
    padded = np.zeros((len(voxels), config.max_points, 4), dtype=np.float32)
    for row, members in zip(padded, voxels.values(), strict=True):
        row[: len(members)] = members
    return padded, np.array(list(voxels)).reshape(-1, 3), np.array([*map(len, voxels.values())])
