"""Overlap of oriented boxes, against shapely, and merging."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from perception.boxes import (
    SHARPNESS,
    footprints,
    iou_3d,
    iou_among,
    iou_bev,
    nms,
    weighted_fusion,
)
from perception.types import Boxes


def make(*rows: tuple[float, ...], scores: list[float] | None = None) -> Boxes:
    """Boxes of (x, y, z, length, width, height, heading)."""
    values = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return Boxes(
        centers=values[:, :3],
        sizes=values[:, 3:6],
        headings=values[:, 6],
        scores=np.array(scores if scores is not None else [1.0] * len(rows)),
        labels=("vehicle",) * len(rows),
    )


coordinate = st.floats(-6, 6)
side = st.floats(0.3, 8)
box = st.tuples(coordinate, coordinate, st.floats(-1, 1), side, side, side, st.floats(-7, 7))


@given(st.lists(box, min_size=1, max_size=4), st.lists(box, min_size=1, max_size=4))
def test_bev_overlap_equals_shapelys(
    a: list[tuple[float, ...]], b: list[tuple[float, ...]]
) -> None:
    first, second = make(*a), make(*b)
    polygons = [[shapely.Polygon(c) for c in footprints(boxes)] for boxes in (first, second)]
    for i, p in enumerate(polygons[0]):
        for j, q in enumerate(polygons[1]):
            expected = p.intersection(q).area / p.union(q).area
            assert iou_bev(first, second)[i, j] == pytest.approx(expected, abs=1e-6)


def test_volume_overlap_counts_the_shared_height() -> None:
    low, high = make((0, 0, 0, 2, 2, 2, 0)), make((0, 0, 1, 2, 2, 2, 0))
    assert iou_bev(low, high)[0, 0] == pytest.approx(1.0)
    assert iou_3d(low, high)[0, 0] == pytest.approx(1 / 3)
    assert iou_3d(low, make((0, 0, 5, 2, 2, 2, 0)))[0, 0] == 0.0


def test_overlap_with_no_boxes_has_no_entries() -> None:
    assert iou_bev(Boxes.empty(), make((0, 0, 0, 1, 1, 1, 0))).shape == (0, 1)


@given(st.lists(box, max_size=5))
def test_overlap_among_boxes_is_that_of_each_with_those_after_it(
    rows: list[tuple[float, ...]],
) -> None:
    boxes = make(*rows)
    assert np.array_equal(iou_among(boxes), np.triu(iou_bev(boxes, boxes), 1))


def test_nms_keeps_the_best_of_each_group() -> None:
    boxes = make(
        (0, 0, 0, 4, 2, 1, 0),
        (0.3, 0, 0, 4, 2, 1, 0),
        (9, 0, 0, 4, 2, 1, 0),
        scores=[0.5, 0.9, 0.1],
    )
    kept = nms(boxes)
    assert kept.scores.tolist() == [0.9, 0.1]
    assert kept.centers[:, 0].tolist() == [0.3, 9.0]


def test_weighted_fusion_averages_by_score_and_treats_headings_modulo_pi() -> None:
    boxes = make((0, 0, 0, 4, 2, 1, 0.1), (1, 0, 0, 4, 2, 1, 0.1 + math.pi), scores=[0.8, 0.7])
    fused = weighted_fusion(boxes)
    assert len(fused) == 1
    other = 0.7**SHARPNESS / (0.7**SHARPNESS + 0.8**SHARPNESS)
    assert fused.centers[0, 0] == pytest.approx(other)
    assert fused.headings[0] == pytest.approx(0.1)
    assert fused.scores[0] == pytest.approx(1 - 0.2 * 0.3)
    # Nobody knows better.
    same = weighted_fusion(make((0, 0, 0, 4, 2, 1, 0), (1, 0, 0, 4, 2, 1, 0), scores=[0.0, 0.0]))
    assert same.centers[0, 0] == pytest.approx(0.5)


def test_weighted_fusion_leaves_boxes_that_stand_apart() -> None:
    boxes = make((0, 0, 0, 4, 2, 1, 0), (0, 5, 0, 4, 2, 1, 0))
    assert len(weighted_fusion(boxes)) == 2
    assert len(weighted_fusion(Boxes.empty())) == 0
