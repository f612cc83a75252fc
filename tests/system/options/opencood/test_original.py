"""Held against OpenCOOD itself: $OPENCOOD is a checkout of its repository.

Nothing of it needs to be compiled: voxels come from here, and what it imports without using it for
these models is replaced by empty modules.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from options.opencood.clouds import mirrored, network_cloud
from options.opencood.model import OpenCoodModel, load
from options.opencood.pillars import sort_into_pillars
from perception.boxes import iou_3d
from perception.types import Boxes
from swarm.geometry import Pose
from tests.support.opencood_models import (
    PUBLISHED,
    padded_voxels,
    random_state,
    scan,
    settings,
    write_model,
)

ORIGINAL = Path(os.environ.get("OPENCOOD", "/nowhere"))
pytestmark = [
    pytest.mark.peer,
    pytest.mark.skipif(
        not (ORIGINAL / "opencood" / "models").is_dir(),
        reason="git clone https://github.com/DerrickXuNu/OpenCOOD, and set OPENCOOD to that folder",
    ),
]

TOLERANCE = 1e-4
SENDERS = [
    None,
    Pose(6, 3, 0.1, 0.01, -0.02, 0.7).matrix(),
    Pose(-9, 1, 0, 0, 0, 3.0).matrix(),
    Pose(2, -8, 0.3, 0, 0.02, -1.5).matrix(),
    Pose(15, 0, 0, 0, 0, 1).matrix(),
]
"""The ego, and others by their place in its frame."""


@pytest.fixture(scope="module", autouse=True)
def original() -> Iterator[None]:
    """OpenCOOD's modules, importable for these tests only."""
    before = set(sys.modules)
    sys.path.insert(0, str(ORIGINAL))
    for name, attribute, value in (
        ("data_utils.datasets", "GT_RANGE", [-140, -40, -3, 140, 40, 1]),
        ("data_utils.post_processor", "__path__", []),
        ("utils.box_overlaps", "bbox_overlaps", None),
        ("visualization", "vis_utils", None),
    ):
        stand_in = ModuleType(f"opencood.{name}")
        setattr(stand_in, attribute, value)
        sys.modules[stand_in.__name__] = stand_in
    folder = ORIGINAL / "opencood" / "data_utils" / "post_processor"
    sys.modules["opencood.data_utils.post_processor"].__path__ = [str(folder)]
    yield
    sys.path.remove(str(ORIGINAL))
    for name in set(sys.modules) - before:
        if name.split(".")[0] == "opencood":
            del sys.modules[name]


def both(tmp_path: Path, values: dict[str, Any]) -> tuple[OpenCoodModel, torch.nn.Module]:
    """Our model and the original with the same random weights."""
    model = load(write_model(tmp_path, values))
    args = values["model"]["args"]
    args["point_pillar_scatter"]["grid_size"] = np.array([*model.config.grid, 1])
    name = values["model"]["core_method"]
    module = importlib.import_module(f"opencood.models.{name}")
    theirs = getattr(module, "".join(part.title() for part in name.split("_")))(args)
    theirs.load_state_dict(random_state(theirs))
    return model, theirs.eval()


def clouds(count: int) -> list[NDArray[np.float32]]:
    return [
        np.concatenate(list(network_cloud(scan(seed), where)))
        for seed, where in enumerate(SENDERS[:count])
    ]


def their_heads(
    theirs: torch.nn.Module, given: list[NDArray[np.float32]], model: OpenCoodModel
) -> dict[str, torch.Tensor]:
    parts = [padded_voxels(cloud, model.config) for cloud in given]
    cells = [np.pad(p[1], ((0, 0), (1, 0)), constant_values=i) for i, p in enumerate(parts)]
    lidar = {
        "voxel_features": torch.from_numpy(np.concatenate([p[0] for p in parts])),
        "voxel_coords": torch.from_numpy(np.concatenate(cells)),
        "voxel_num_points": torch.from_numpy(np.concatenate([p[2] for p in parts])),
    }
    with torch.no_grad():
        found: dict[str, torch.Tensor] = theirs(
            {"processed_lidar": lidar, "record_len": torch.tensor([len(given)])}
        )
    return found


def our_heads(
    model: OpenCoodModel, given: list[NDArray[np.float32]]
) -> tuple[torch.Tensor, torch.Tensor]:
    with torch.no_grad():
        sent = [model.network.encode(sort_into_pillars([one], model.config)) for one in given]
        return model.network.heads(sent)


def difference(model: OpenCoodModel, theirs: torch.nn.Module, count: int) -> float:
    given = clouds(count)
    expected = their_heads(theirs, given, model)
    logits, offsets = our_heads(model, given)
    assert expected["psm"].std() > 0.1
    return max(
        float((logits - expected["psm"][0]).abs().max()),
        float((offsets - expected["rm"][0]).abs().max()),
    )


@pytest.mark.parametrize("fusion", ["Early", "Late"])
def test_point_pillar_gives_the_originals_maps(tmp_path: Path, fusion: str) -> None:
    model, theirs = both(tmp_path, settings(fusion, **PUBLISHED))
    assert difference(model, theirs, 1) < TOLERANCE


@pytest.mark.parametrize("compression", [0, 1, 2])
@pytest.mark.parametrize("vehicles", [1, 2, 5])
def test_attfuse_gives_the_originals_maps(tmp_path: Path, compression: int, vehicles: int) -> None:
    model, theirs = both(tmp_path, settings("Intermediate", compression, **PUBLISHED))
    assert difference(model, theirs, vehicles) < TOLERANCE


@pytest.mark.parametrize(("fusion", "vehicles"), [("Early", 1), ("Intermediate", 3)])
def test_boxes_are_those_of_the_originals_post_processor(
    tmp_path: Path, fusion: str, vehicles: int
) -> None:
    values = settings(fusion, **PUBLISHED)
    model, theirs = both(tmp_path, values)
    given = clouds(vehicles)
    expected = their_boxes(values["postprocess"], their_heads(theirs, given, model), model)
    ours = (
        model.detect([(scan(0), None)])
        if fusion == "Early"
        else model.fuse(
            [model.encode(scan(i), where) for i, where in enumerate(SENDERS[:vehicles])]
        )
    )
    assert len(expected) > 20
    assert len(ours) == len(expected)
    # Neighbours of nearly the same score may change places.
    overlap = iou_3d(mirrored(ours), expected)
    partner = overlap.argmax(axis=1)
    assert len(set(partner)) == len(expected)
    assert overlap.max(axis=1).min() > 0.999
    assert np.abs(ours.scores - expected.scores[partner]).max() < TOLERANCE


def their_boxes(
    params: dict[str, Any], heads: dict[str, torch.Tensor], model: OpenCoodModel
) -> Boxes:
    """Corners that OpenCOOD reports, as boxes in its left-handed frame."""
    name = "opencood.data_utils.post_processor.voxel_postprocessor"
    nx, ny = model.config.grid
    params["anchor_args"] |= {"W": nx, "H": ny, "vw": 0.4, "vh": 0.4}
    processor = importlib.import_module(name).VoxelPostprocessor(params, train=False)
    anchors = torch.from_numpy(processor.generate_anchor_box())
    corners, scores = processor.post_process(
        {"ego": {"transformation_matrix": torch.eye(4), "anchor_box": anchors}}, {"ego": heads}
    )
    corners, scores = corners.numpy().astype(np.float64), scores.numpy().astype(np.float64)
    along, across = corners[:, 0] - corners[:, 3], corners[:, 1] - corners[:, 0]
    return Boxes(
        centers=corners.mean(axis=1),
        sizes=np.stack(
            [
                np.hypot(*along[:, :2].T),
                np.hypot(*across[:, :2].T),
                corners[:, 4, 2] - corners[:, 0, 2],
            ],
            axis=1,
        ),
        headings=np.arctan2(along[:, 1], along[:, 0]),
        scores=scores,
        labels=("vehicle",) * len(scores),
    )
