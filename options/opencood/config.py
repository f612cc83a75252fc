"""What an OpenCOOD `config.yaml` says about a PointPillars model, checked and typed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from options.opencood.settings_file import Section, read_settings
from swarm.errors import PerceptionError

CONFIG_FILE = "config.yaml"
FUSIONS = {
    "EarlyFusionDataset": "early",
    "LateFusionDataset": "late",
    "IntermediateFusionDataset": "intermediate",
}
MODELS = {
    "point_pillar": ("EarlyFusionDataset", "LateFusionDataset"),
    "point_pillar_intermediate": ("IntermediateFusionDataset",),
}
MAX_CELLS = 4_000_000
_CHANNELS = 2048


@dataclass(frozen=True, slots=True)
class BackboneConfig:
    """The convolutional pyramid: one entry a level in every tuple."""

    layers: tuple[int, ...]
    """Convolutions after the one that scales down."""
    strides: tuple[int, ...]
    filters: tuple[int, ...]
    upsampling: tuple[int, ...]
    """Back to the resolution of the first level."""
    upsampled_filters: tuple[int, ...]
    compression: int
    """How often a map is halved, in size and in channels, before it is sent; 0: not at all."""


@dataclass(frozen=True, slots=True)
class OpenCoodConfig:
    """One model; lengths in metres in the network's left-handed frame, angles in radians."""

    core_method: str
    fusion: str
    """early, late or intermediate: what the weights were trained for."""
    lidar_range: tuple[float, ...]
    """x, y, z from; x, y, z to."""
    voxel_size: tuple[float, ...]
    max_points: int
    """Points of one pillar that count; later ones are dropped."""
    max_voxels: int
    anchor_size: tuple[float, float, float]
    """Length, width, height."""
    anchor_yaws: tuple[float, ...]
    score_threshold: float
    nms_threshold: float
    pillar_channels: int
    backbone: BackboneConfig

    @property
    def grid(self) -> tuple[int, int]:
        """Pillars along x and along y."""
        low, high = self.lidar_range[:2], self.lidar_range[3:5]
        cells = [round((b - a) / s) for a, b, s in zip(low, high, self.voxel_size, strict=False)]
        return cells[0], cells[1]

    @property
    def feature_stride(self) -> int:
        """Pillars a cell of the detection map, along each axis."""
        return self.backbone.strides[0] // self.backbone.upsampling[0]


def read_config(directory: Path) -> OpenCoodConfig:
    """The configuration in an OpenCOOD model directory.

    Raises PerceptionError that names the setting, its value and what is allowed.
    """
    top = Section(read_settings(Path(directory) / CONFIG_FILE))
    model = top.section("model")
    core_method = model.choice("core_method", *MODELS)
    fusion = top.section("fusion")
    method = fusion.choice("core_method", *MODELS[core_method])
    if isinstance(fusion.values.get("args"), dict) and "proj_first" in fusion.values["args"]:
        # Attention compares cells in place, so every map must be made in the ego's frame.
        fusion.section("args").choice("proj_first", True)

    args = model.section("args")
    preprocess, postprocess = top.section("preprocess"), top.section("postprocess")
    preprocess.choice("core_method", "SpVoxelPreprocessor")
    postprocess.choice("core_method", "VoxelPostprocessor")
    postprocess.choice("order", "hwl")
    voxels, anchors = preprocess.section("args"), postprocess.section("anchor_args")
    yaws = anchors.numbers("r", None, -360, 360)
    for section, key in ((anchors, "num"), (args, "anchor_number"), (args, "anchor_num")):
        section.choice(key, len(yaws))
    config = OpenCoodConfig(
        core_method=core_method,
        fusion=FUSIONS[method],
        lidar_range=args.numbers("lidar_range", 6, -1000, 1000),
        voxel_size=args.numbers("voxel_size", 3, 0.01, 100),
        max_points=voxels.whole("max_points_per_voxel", 1, 1000),
        max_voxels=voxels.whole("max_voxel_test", 1, MAX_CELLS),
        anchor_size=(
            anchors.number("l", 0.1, 100),
            anchors.number("w", 0.1, 100),
            anchors.number("h", 0.1, 100),
        ),
        anchor_yaws=tuple(math.radians(yaw) for yaw in yaws),
        score_threshold=postprocess.section("target_args").number("score_threshold", 0, 1),
        nms_threshold=postprocess.number("nms_thresh", 0, 1),
        pillar_channels=_pillar_channels(args),
        backbone=_backbone(args, core_method),
    )
    _check_grid(config)
    stated = (preprocess, "cav_lidar_range"), (anchors, "cav_lidar_range"), (voxels, "voxel_size")
    for section, key in stated:
        expected = config.voxel_size if key == "voxel_size" else config.lidar_range
        if section.numbers(key, len(expected), -1000, 1000) != expected:
            raise section.wrong(key, f"what model.args says, {list(expected)}")
    if "feature_stride" in anchors.values:
        anchors.choice("feature_stride", config.feature_stride)
    elif config.feature_stride != 2:
        raise anchors.wrong("feature_stride", str(config.feature_stride))
    return config


def _pillar_channels(args: Section) -> int:
    pillars = args.section("pillar_vfe")
    pillars.choice("use_norm", True)
    pillars.choice("with_distance", False)
    pillars.choice("use_absolute_xyz", True)
    (channels,) = pillars.wholes("num_filters", 1, 1, _CHANNELS)
    args.section("point_pillar_scatter").choice("num_features", channels)
    return channels


def _backbone(args: Section, core_method: str) -> BackboneConfig:
    section = args.section("base_bev_backbone")
    layers = section.wholes("layer_nums", None, 0, 64)
    levels = len(layers)
    found = BackboneConfig(
        layers=layers,
        strides=section.wholes("layer_strides", levels, 1, 8),
        filters=section.wholes("num_filters", levels, 1, _CHANNELS),
        upsampling=section.wholes("upsample_strides", levels, 1, 64),
        upsampled_filters=section.wholes("num_upsample_filter", levels, 1, _CHANNELS),
        compression=section.whole("compression", 0, 8)
        if core_method == "point_pillar_intermediate" and "compression" in section.values
        else 0,
    )
    scales = [math.prod(found.strides[: i + 1]) / up for i, up in enumerate(found.upsampling)]
    if len(set(scales)) != 1 or scales[0] != int(scales[0]):
        raise section.wrong("upsample_strides", "what brings all levels to one resolution")
    for level, channels in enumerate(found.filters[: found.compression]):
        if channels % 2 ** (found.compression - level):
            raise section.wrong("compression", f"what can halve {channels} channels so often")
    return found


def _check_grid(config: OpenCoodConfig) -> None:
    low, high = config.lidar_range[:3], config.lidar_range[3:]
    if any(a >= b for a, b in zip(low, high, strict=True)):
        raise PerceptionError(
            f"OpenCOOD configuration: model.args.lidar_range is {list(config.lidar_range)}; "
            "allowed: x, y, z from, then x, y, z to, each larger"
        )
    nx, ny = config.grid
    depth = round((high[2] - low[2]) / config.voxel_size[2])
    steps = config.backbone.strides
    smallest = max(
        math.prod(steps),
        *(
            math.prod(steps[: i + 1]) * 2 ** max(config.backbone.compression - i, 0)
            for i in range(len(steps))
        ),
    )
    if depth != 1 or nx * ny > MAX_CELLS or nx < 1 or ny < 1 or nx % smallest or ny % smallest:
        raise PerceptionError(
            f"OpenCOOD configuration: range and voxel size make {nx} x {ny} x {depth} pillars; "
            f"allowed: up to {MAX_CELLS} on one floor, in multiples of {smallest} (its strides)"
        )
