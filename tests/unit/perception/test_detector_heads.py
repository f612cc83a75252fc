"""Heatmaps and channels to boxes: the reverse of what training teaches."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from perception.boxes import iou_3d
from perception.detector.heads import MAX_PEAKS, boxes_at, read_boxes
from perception.detector.network import BOX_CHANNELS
from perception.detector.pillars import pillarise
from perception.types import Boxes
from research.training.targets import make_targets
from tests.support.tiny_detector import TINY, random_cloud, random_network

ROWS, COLUMNS = TINY.cells


@st.composite
def scenes(draw: st.DrawFn) -> Boxes:
    """Boxes on the small grid; a person's footprint is square, as its symmetry says."""
    rows = []
    labels = []
    for _ in range(draw(st.integers(1, 4))):
        label = draw(st.sampled_from(TINY.labels))
        length, width = (draw(st.floats(0.3, 6.0)) for _ in range(2))
        rows.append(
            (
                draw(st.floats(-6.39, 6.39)),
                draw(st.floats(-4.79, 4.79)),
                draw(st.floats(-1.5, 1.5)),
                length,
                length if label == "person" else width,
                draw(st.floats(0.3, 3.0)),
                draw(st.floats(0, 6.28)),
            )
        )
        labels.append(label)
    table = np.array(rows)
    return Boxes(table[:, :3], table[:, 3:6], table[:, 6], np.ones(len(rows)), tuple(labels))


@given(scenes())
def test_boxes_are_read_from_what_cells_are_taught(truth: Boxes) -> None:
    targets = make_targets(TINY, [truth], [np.full(len(truth), 50)])
    assert len(targets.map) >= 4 * len(truth)
    label = np.array([TINY.labels.index(name) for name in targets.truth.labels])
    told = targets.boxes.numpy().astype(np.float64)
    found = boxes_at(
        TINY, told, targets.row.numpy(), targets.column.numpy(), label, np.ones(len(told))
    )
    assert np.diagonal(iou_3d(found, targets.truth)).min() > 0.999
    assert found.labels == targets.truth.labels
    turns = np.array(TINY.symmetry)[label]
    apart = (found.headings - targets.truth.headings) * turns
    assert np.abs(np.sin(apart / 2)).max() < 1e-4


def painted(*peaks: tuple[int, int, int, float]) -> torch.Tensor:
    """Heat logits with peaks of (class, row, column, logit) on nothing."""
    heat = torch.full((len(TINY.labels), ROWS, COLUMNS), -20.0)
    for label, row, column, logit in peaks:
        heat[label, row, column] = logit
    return heat


def channels() -> torch.Tensor:
    """Boxes of one cubic metre in the middles of their cells, half sure of their IoU."""
    told = torch.zeros(BOX_CHANNELS, ROWS, COLUMNS)
    told[6] = 1.0
    return told


def test_a_peak_is_a_box_in_the_middle_of_its_cell() -> None:
    found = read_boxes(TINY, painted((2, 5, 7, 2.0)), channels())
    assert found.labels == ("forklift",)
    assert np.allclose(found.centers, [[-6.4 + 7.5 * 0.4, -4.8 + 5.5 * 0.4, 0.0]])
    assert np.allclose(found.sizes, 1.0)
    assert found.headings[0] == 0.0
    assert found.scores[0] == pytest.approx(math.sqrt(1 / (1 + math.exp(-2.0)) * 0.5))


@pytest.mark.parametrize(("row", "column"), [(5, 8), (6, 7), (6, 8), (4, 6)])
def test_of_neighbouring_peaks_the_best_is_kept(row: int, column: int) -> None:
    # Boxes of a few centimetres overlap nothing: it is the peak that must be the best.
    small = channels()
    small[3:6] = math.log(0.05)
    found = read_boxes(TINY, painted((1, 5, 7, 2.0), (1, row, column, 1.9)), small)
    assert len(found) == 1
    assert np.allclose(found.centers[0, :2], [-6.4 + 7.5 * 0.4, -4.8 + 5.5 * 0.4])


def test_boxes_of_two_classes_in_one_place_are_one() -> None:
    found = read_boxes(TINY, painted((1, 5, 7, 1.0), (2, 5, 7, 2.0)), channels())
    assert found.labels == ("forklift",)


def test_peaks_that_stand_apart_are_boxes_of_their_own_best_first() -> None:
    peaks = ((0, 0, 0, 0.5), (1, ROWS - 1, COLUMNS - 1, 3.0), (2, 12, 16, 1.0))
    found = read_boxes(TINY, painted(*peaks), channels())
    assert found.labels == ("robot", "forklift", "person")
    assert (np.diff(found.scores) < 0).all()


def test_a_box_that_is_thought_to_be_wrong_scores_low() -> None:
    told = channels()
    told[8, 5, 7] = -8.0
    assert len(read_boxes(TINY, painted((2, 5, 7, 2.0)), told)) == 0
    told[8, 5, 7] = -1.0
    unsure = read_boxes(TINY, painted((2, 5, 7, 2.0)), told)
    sure = read_boxes(TINY, painted((2, 5, 7, 2.0)), channels())
    assert unsure.scores[0] < sure.scores[0]


def test_nothing_is_found_where_nothing_is_likely() -> None:
    assert len(read_boxes(TINY, painted(), channels())) == 0


@pytest.mark.parametrize("scale", [0.0, 1.0, 1e3, 1e18, 1e38])
def test_what_no_network_has_learnt_is_still_boxes(scale: float) -> None:
    generator = torch.Generator().manual_seed(3)
    heat = torch.randn(3, ROWS, COLUMNS, generator=generator)
    told = torch.randn(BOX_CHANNELS, ROWS, COLUMNS, generator=generator) * scale
    found = read_boxes(TINY, heat.mul(scale).clamp(-1e38, 1e38), told.clamp(-1e38, 1e38))
    assert 0 < len(found) <= MAX_PEAKS
    assert np.isfinite(found.centers).all()
    assert (found.sizes > 0).all()
    assert (found.sizes < 55).all()
    assert ((found.scores >= 0) & (found.scores <= 1)).all()
    assert (np.diff(found.scores) <= 0).all()


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("channel", [0, 2, 3, 6, 8])
def test_channels_that_are_no_numbers_make_no_box_that_is_none(bad: float, channel: int) -> None:
    told = channels()
    told[channel, 5, 7] = bad
    found = read_boxes(TINY, painted((2, 5, 7, 2.0), (1, 15, 20, 2.0)), told)
    for column in (found.centers, found.sizes, found.headings, found.scores):
        assert np.isfinite(column).all()
    assert "robot" in found.labels


def test_heat_that_is_no_number_is_no_peak() -> None:
    heat = painted((2, 5, 7, math.nan), (1, 15, 20, 2.0))
    assert read_boxes(TINY, heat, channels()).labels == ("robot",)


@given(hnp.arrays(np.float32, 2, elements=st.floats(-2, 2, width=32)), st.integers(0, 2))
def test_headings_are_below_a_whole_turn(turn: np.ndarray, label: int) -> None:
    told = np.zeros((1, BOX_CHANNELS))
    told[0, 6:8] = turn
    one = np.array([1])
    heading = boxes_at(TINY, told, one, one, np.array([label]), np.ones(1)).headings[0]
    assert 0.0 <= heading < 2 * math.pi


def test_a_heading_just_below_zero_is_below_a_whole_turn() -> None:
    told = np.zeros((1, BOX_CHANNELS))
    told[0, 6:8] = 1.0, -1e-20
    one = np.array([1])
    heading = boxes_at(TINY, told, one, one, one, np.ones(1)).headings[0]
    assert 0.0 <= heading < 2 * math.pi


def test_an_untrained_network_finds_little_and_breaks_nothing() -> None:
    network = random_network()
    with torch.inference_mode():
        heat, told = network.decoder(network.encoder(pillarise([random_cloud()], TINY)))
    found = read_boxes(TINY, heat[0], told[0])
    assert np.isfinite(found.centers).all()
    assert len(found) <= MAX_PEAKS
