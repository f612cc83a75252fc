"""OpenCOOD models as fusion algorithms: payloads, what the ego makes of them, what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from options.opencood.fusions import (
    MAX_BOXES,
    OpenCoodEarly,
    OpenCoodIntermediate,
    OpenCoodLate,
    opencood_fusion,
)
from options.opencood.model import OpenCoodModel, load
from options.opencood.network import attend
from options.opencood.payload import map_bytes
from perception.codec.boxes import decode_boxes
from perception.fusion.base import Contribution, EncodeOptions
from perception.types import Boxes
from swarm.errors import PayloadError, PerceptionError
from swarm.geometry import Matrix, Pose, invert, pose_of
from tests.support.opencood_models import scan, settings, write_model

EGO = Pose(100.0, 50.0, 2.0, 0.0, 0.0, 0.5).matrix()
OTHER = EGO @ Pose(6.0, 3.0, 0.0, 0.0, 0.0, 1.0).matrix()


@pytest.fixture(scope="module")
def early(tmp_path_factory: pytest.TempPathFactory) -> OpenCoodModel:
    return load(write_model(tmp_path_factory.mktemp("early"), settings("Early")))


@pytest.fixture(scope="module")
def attfuse(tmp_path_factory: pytest.TempPathFactory) -> OpenCoodModel:
    return load(write_model(tmp_path_factory.mktemp("att"), settings("Intermediate", 1)))


def asked(sensor: Matrix, ego: Matrix) -> EncodeOptions:
    """What a robot is asked for, and where its sensor is."""
    return EncodeOptions(pose=pose_of(sensor), reference=pose_of(ego))


def same(a: Boxes, b: Boxes, atol: float = 1e-3) -> bool:
    """The same boxes in any order: those of nearly one score may change places."""
    apart = np.linalg.norm(a.centers[:, None] - b.centers[None], axis=2)
    return len(a) == len(b) > 0 and len(set(np.argwhere(apart <= atol)[:, 1])) == len(b)


def test_a_model_offers_the_fusion_that_it_was_trained_for(
    early: OpenCoodModel, attfuse: OpenCoodModel, tmp_path: Path
) -> None:
    late = load(write_model(tmp_path, settings("Late")))
    for model, kind in (
        (early, OpenCoodEarly),
        (late, OpenCoodLate),
        (attfuse, OpenCoodIntermediate),
    ):
        assert type(opencood_fusion(model)) is kind
    with pytest.raises(PerceptionError, match="allowed here: point_pillar_intermediate"):
        OpenCoodIntermediate(early)
    with pytest.raises(PerceptionError, match="allowed here: point_pillar"):
        OpenCoodLate(attfuse)


def test_early_and_late_are_one_set_of_weights(early: OpenCoodModel) -> None:
    alone = early.detect([(scan(0), None)]).transformed(EGO)
    for fusion in (OpenCoodEarly(early), OpenCoodLate(early)):
        assert same(fusion.fuse(scan(0), EGO, []).boxes, alone)
    sent = decode_boxes(OpenCoodLate(early).encode(scan(0), EncodeOptions()))
    assert len(sent) == MAX_BOXES < len(alone)
    assert same(sent.transformed(EGO), alone.take(np.arange(MAX_BOXES)), atol=0.01)


def test_early_detects_in_the_merged_cloud(early: OpenCoodModel) -> None:
    fusion = OpenCoodEarly(early)
    payload = fusion.encode(scan(1), EncodeOptions(max_error_m=0.001))
    result = fusion.fuse(scan(0), EGO, [Contribution("a", payload, OTHER)])
    merged = early.detect([(scan(0), None), (scan(1), invert(EGO) @ OTHER)])
    assert result.rejected == {}
    # The codec moves points by up to a millimetre, some of them into another pillar.
    near = np.linalg.norm(
        result.boxes.centers[:, None] - merged.transformed(EGO).centers[None], axis=2
    )
    assert np.median(near.min(axis=1)) < 0.05


def test_late_keeps_the_best_of_boxes_that_overlap(early: OpenCoodModel) -> None:
    fusion = OpenCoodLate(early)
    payload = fusion.encode(scan(0), EncodeOptions())
    alone = fusion.fuse(scan(0), EGO, []).boxes
    twice = fusion.fuse(scan(0), EGO, [Contribution("a", payload, EGO)]).boxes
    assert same(twice, alone, atol=0.01)
    with_other = fusion.fuse(scan(0), EGO, [Contribution("a", payload, OTHER)]).boxes
    assert len(with_other) > len(alone)


def test_a_map_on_the_wire_has_the_announced_size_and_gives_the_same_boxes(
    attfuse: OpenCoodModel,
) -> None:
    maps = [attfuse.encode(scan(0)), attfuse.encode(scan(1), invert(EGO) @ OTHER)]
    assert tuple(maps[0].shape) == attfuse.map_shape() == (8, 16, 32)
    expected = attfuse.fuse(maps).transformed(EGO)
    for number_bytes, agreeing in ((4, 1.0), (2, 0.9)):
        fusion = OpenCoodIntermediate(attfuse, number_bytes)
        payload = fusion.encode(scan(1), asked(OTHER, EGO))
        assert len(payload) == map_bytes(attfuse.map_shape(), number_bytes)
        result = fusion.fuse(scan(0), EGO, [Contribution("a", payload, OTHER)])
        assert result.rejected == {}
        # Rounding may turn a duplicate of nearly the same score into the one that is kept.
        apart = np.linalg.norm(result.boxes.centers[:, None] - expected.centers[None], axis=2)
        assert np.mean(apart.min(axis=1) < 0.02) >= agreeing


def test_a_map_helps_only_where_it_says_something(attfuse: OpenCoodModel) -> None:
    own, other = attfuse.encode(scan(0)), attfuse.encode(scan(1))
    assert same(attfuse.fuse([own, own, own]), attfuse.fuse([own]))
    assert not same(attfuse.fuse([own, other]), attfuse.fuse([own]))
    assert same(attfuse.fuse([own, other, own]), attfuse.fuse([own, own, other]))


def test_attention_weighs_each_cell_by_its_likeness_to_the_egos() -> None:
    own = torch.tensor([2.0, 0.0]).view(1, 2, 1, 1).repeat(1, 1, 1, 2)
    other = own.clone()
    other[0, :, 0, 1] = torch.tensor([0.0, 2.0])
    fused = attend([own, other])
    weight = 1 / (1 + np.exp(-4 / np.sqrt(2)))
    np.testing.assert_allclose(fused[0, :, 0, 0], [2.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(fused[0, :, 0, 1], [2 * weight, 2 * (1 - weight)], atol=1e-6)


def test_an_empty_scan_makes_a_map_that_can_be_fused(attfuse: OpenCoodModel) -> None:
    empty = np.zeros((0, 3), dtype=np.float32)
    fusion = OpenCoodIntermediate(attfuse)
    payload = fusion.encode(scan(1), asked(EGO, EGO))
    result = fusion.fuse(empty, EGO, [Contribution("a", payload, EGO)])
    assert result.rejected == {}


def test_a_map_that_cannot_be_fused_is_refused_and_the_others_go_on(
    attfuse: OpenCoodModel, tmp_path: Path
) -> None:
    fusion = OpenCoodIntermediate(attfuse)
    good = fusion.encode(scan(1), asked(OTHER, EGO))
    other_weights = load(write_model(tmp_path / "w", settings("Intermediate", 1), seed=5))
    other_grid = load(write_model(tmp_path / "g", settings("Intermediate", 0)))
    other_grid.version = attfuse.version
    payloads = {
        "good": good,
        "short": good[:-40],
        "empty": b"",
        "damaged": good[:500] + bytes([good[500] ^ 255]) + good[501:],
        "weights": OpenCoodIntermediate(other_weights).encode(scan(1), asked(OTHER, EGO)),
        "grid": OpenCoodIntermediate(other_grid).encode(scan(1), asked(OTHER, EGO)),
        "frame": fusion.encode(scan(1), asked(OTHER, OTHER)),
        "nothing": OpenCoodIntermediate(attfuse).encode(scan(1), asked(OTHER, EGO * np.nan)),
    }
    contributions = [Contribution(name, data, OTHER) for name, data in payloads.items()]
    result = fusion.fuse(scan(0), EGO, contributions)
    assert set(result.rejected) == set(payloads) - {"good"}
    assert "other weights" in result.rejected["weights"]
    assert "expected (8, 16, 32)" in result.rejected["grid"]
    assert "the ego's frame is at" in result.rejected["frame"]
    alone = fusion.fuse(scan(0), EGO, [Contribution("good", good, OTHER)]).boxes
    assert same(result.boxes, alone)


def test_the_ego_asks_for_maps_in_its_own_frame(attfuse: OpenCoodModel) -> None:
    fusion = OpenCoodIntermediate(attfuse)
    gathering = fusion.begin(scan(0), EGO)
    ask = gathering.ask()
    assert ask.reference is not None
    np.testing.assert_allclose(ask.reference.matrix(), EGO, atol=1e-9)
    options = EncodeOptions(pose=pose_of(OTHER), reference=ask.reference)
    gathering.add(Contribution("a", fusion.encode(scan(1), options), OTHER))
    maps = [attfuse.encode(scan(0)), attfuse.encode(scan(1), invert(EGO) @ OTHER)]
    assert abs(len(gathering.finish()) - len(attfuse.fuse(maps))) <= 3


def test_a_map_that_was_made_for_nobody_lies_in_the_sensors_frame(attfuse: OpenCoodModel) -> None:
    fusion = OpenCoodIntermediate(attfuse)
    assert fusion.encode(scan(1), EncodeOptions(pose=pose_of(OTHER))) == fusion.encode(
        scan(1), asked(OTHER, OTHER)
    )


@pytest.mark.parametrize("fusion", [OpenCoodEarly, OpenCoodLate])
def test_a_payload_that_is_no_points_or_boxes_is_refused(
    early: OpenCoodModel, fusion: type[OpenCoodEarly] | type[OpenCoodLate]
) -> None:
    gathering = fusion(early).begin(scan(0), EGO)
    with pytest.raises(PayloadError):
        gathering.add(Contribution("a", b"nonsense", OTHER))
    assert len(gathering.finish()) > 0
