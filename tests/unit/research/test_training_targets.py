"""What training teaches: targets, and samples that can be taught."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from perception.boxes import iou_3d
from perception.detector.heads import boxes_at, read_boxes
from perception.detector.network import BOX_CHANNELS
from perception.types import Boxes
from research.training.losses import box_losses, heat_loss
from research.training.samples import draw, mirrored
from research.training.targets import MIN_HITS, Targets, make_targets
from tests.support.tiny_detector import TINY
from tests.unit.perception.test_boxes import make
from worlds.factory.world import FactoryWorld

ROWS, COLUMNS = TINY.cells


def robot(x: float, y: float, heading: float = 0.5) -> Boxes:
    one = make((x, y, -0.5, 0.9, 0.6, 1.26, heading))
    return Boxes(one.centers, one.sizes, one.headings, one.scores, ("robot",))


def taught(boxes: Boxes, hits: int) -> Targets:
    return make_targets(TINY, [boxes], [np.full(len(boxes), hits, dtype=np.int64)])


def read(targets: Targets) -> Boxes:
    labels = np.array([TINY.labels.index(name) for name in targets.truth.labels], dtype=np.int64)
    told = targets.boxes.numpy().astype(np.float64)
    ones = np.ones(len(labels))
    return boxes_at(TINY, told, targets.row.numpy(), targets.column.numpy(), labels, ones)


def test_an_object_is_taught_at_its_cell_and_the_eight_around_it() -> None:
    targets = taught(robot(0.5, -1.1), 50)
    # 17.25 cells from the left, 9.25 from the lower edge.
    assert (targets.heat == 1.0).nonzero().tolist() == [[0, 1, 9, 17]]
    assert sorted(zip(targets.row.tolist(), targets.column.tolist(), strict=True)) == [
        (row, column) for row in (8, 9, 10) for column in (16, 17, 18)
    ]
    assert targets.weight.sum() == 1.0 + 8 * 0.25
    middle = targets.boxes[targets.weight == 1.0][0]
    expected = [-0.25, -0.25, -0.5, math.log(0.9), math.log(0.6), math.log(1.26)]
    assert torch.allclose(middle[:6], torch.tensor(expected), atol=1e-5)
    assert torch.allclose(middle[6:], torch.tensor([math.cos(1.0), math.sin(1.0)]), atol=1e-5)
    assert targets.counted.min() == 1.0
    assert targets.heat[0, [0, 2]].max() == 0.0


@given(st.lists(st.tuples(st.floats(-6.3, 6.3), st.floats(-4.7, 4.7), st.floats(0, 6.2))))
def test_every_taught_cell_says_its_own_truth(places: list[tuple[float, float, float]]) -> None:
    truth = Boxes.concatenate([robot(*place) for place in places])
    targets = taught(truth, 50)
    assert len(targets.map) >= 4 * len(places)
    if places:
        assert np.diagonal(iou_3d(read(targets), targets.truth)).min() > 0.999


def test_at_a_corner_only_cells_on_the_grid_are_taught() -> None:
    targets = taught(robot(-6.39, 4.79), 50)
    assert sorted(zip(targets.row.tolist(), targets.column.tolist(), strict=True)) == [
        (22, 0), (22, 1), (23, 0), (23, 1)
    ]  # fmt: skip


@pytest.mark.parametrize("place", [(6.5, 0.0), (0.0, -4.9), (-6.41, 0.0), (1e6, 1e6)])
@pytest.mark.parametrize("hits", [2, 50])
def test_what_stands_outside_is_not_taught(place: tuple[float, float], hits: int) -> None:
    targets = taught(robot(*place), hits)
    assert len(targets.map) == 0
    assert targets.heat.max() == 0.0
    assert targets.counted.min() == 1.0


@pytest.mark.parametrize("hits", range(1, MIN_HITS))
def test_with_one_to_three_points_nothing_is_asked_and_nothing_punished(hits: int) -> None:
    targets = taught(robot(0.5, -1.1), hits)
    assert MIN_HITS == 4
    assert len(targets.map) == 0
    assert targets.heat.max() == 0.0
    ignored = (targets.counted == 0.0).nonzero()
    assert [0, 1, 9, 17] in ignored.tolist()
    assert (ignored[:, 1] == 1).all()
    assert (targets.counted == 0).float().mean() < 0.05
    # Belief in the robot costs nothing there, and everywhere else.
    logits = torch.full(targets.heat.shape, -9.0)
    before = float(heat_loss(logits, targets.heat, targets.counted))
    logits[0, 1, 9, 17] = 9.0
    after = float(heat_loss(logits, targets.heat, targets.counted))
    assert after == pytest.approx(before, abs=1e-6)
    logits[0, 1, 0, 0] = 9.0
    assert heat_loss(logits, targets.heat, targets.counted) > before + 1.0


def test_with_no_point_it_is_background() -> None:
    targets = taught(robot(0.5, -1.1), 0)
    assert len(targets.map) == 0
    assert targets.heat.max() == 0.0
    assert targets.counted.min() == 1.0


def test_an_ignored_object_beside_a_taught_one_does_not_hide_it() -> None:
    both = Boxes.concatenate([robot(0.5, -1.1), robot(0.9, -1.1)])
    for order in ([0, 1], [1, 0]):
        hits = np.array([50, 2])[order]
        targets = make_targets(TINY, [both.take(np.array(order))], [hits])
        assert (targets.heat == 1.0).nonzero().tolist() == [[0, 1, 9, 17]]
        assert len(targets.map) == 9
        missed = heat_loss(torch.full(targets.heat.shape, -9.0), targets.heat, targets.counted)
        assert missed > 5.0


def test_maps_are_taught_their_own_boxes() -> None:
    boxes = [robot(0.5, -1.1), Boxes.empty(), robot(-3.0, 2.0)]
    targets = make_targets(TINY, boxes, [np.full(len(b), 9) for b in boxes])
    assert targets.heat.shape == (3, 3, ROWS, COLUMNS)
    assert targets.map.tolist() == [0] * 9 + [2] * 9
    assert np.allclose(targets.truth.centers[:9, 0], 0.5)
    assert np.allclose(targets.truth.centers[9:, 0], -3.0)


def perfect(targets: Targets) -> tuple[torch.Tensor, torch.Tensor]:
    """What a network would say that has learnt its targets."""
    heat = torch.full(targets.heat.shape, -12.0).masked_fill(targets.heat == 1.0, 12.0)
    channels = torch.zeros(len(heat), BOX_CHANNELS, ROWS, COLUMNS)
    channels[targets.map, :8, targets.row, targets.column] = targets.boxes
    channels[:, 8] = 12.0
    return heat, channels


def test_who_says_the_targets_is_not_punished_and_finds_the_boxes() -> None:
    truth = Boxes.concatenate([robot(0.5, -1.1), robot(-3.0, 2.0, 4.0), robot(4.0, 4.0, 3.0)])
    targets = taught(truth, 50)
    heat, channels = perfect(targets)
    assert heat_loss(heat, targets.heat, targets.counted) < 0.01
    boxes, quality = box_losses(TINY, channels, targets)
    assert boxes < 1e-4
    assert quality < 1e-2
    found = read_boxes(TINY, heat[0], channels[0])
    assert len(found) == 3
    assert iou_3d(truth, found).max(axis=1).min() > 0.999
    assert found.scores.min() > 0.99


def test_boxes_that_are_off_cost_and_are_taught_to_be_doubted() -> None:
    targets = taught(robot(0.5, -1.1), 50)
    _, channels = perfect(targets)
    channels[:, 0] += 5.0
    boxes, quality = box_losses(TINY, channels, targets)
    assert boxes > 1.0
    assert quality > 5.0


def test_with_nothing_to_teach_losses_are_zero_and_have_gradients() -> None:
    channels = torch.zeros(1, BOX_CHANNELS, ROWS, COLUMNS, requires_grad=True)
    boxes, quality = box_losses(TINY, channels, taught(Boxes.empty(), 0))
    (boxes + quality).backward()
    assert boxes.item() == quality.item() == 0.0
    assert channels.grad is not None


@given(
    st.lists(
        st.tuples(
            *[st.floats(-50, 50)] * 3, *[st.floats(0.1, 9)] * 3, st.floats(0, 2 * math.pi - 1e-9)
        )
    )
)
def test_mirroring_twice_changes_nothing(rows: list[tuple[float, ...]]) -> None:
    boxes = make(*rows)
    once = mirrored(boxes)
    assert ((once.headings >= 0) & (once.headings <= 2 * math.pi)).all()
    twice = mirrored(once)
    assert np.array_equal(twice.centers, boxes.centers)
    assert np.array_equal(twice.sizes, boxes.sizes)
    assert twice.labels == boxes.labels
    assert np.abs(np.sin((twice.headings - boxes.headings) / 2)).max(initial=0.0) < 1e-9
    assert np.allclose(once.centers[:, 1], -boxes.centers[:, 1])


@pytest.fixture(scope="module")
def world() -> FactoryWorld:
    return FactoryWorld(robots=4, seed=5000)


def on_boxes(points: NDArray[np.float32], boxes: Boxes, slack: float) -> NDArray[np.int64]:
    """How many points lie in each box, made larger by `slack`."""
    counts = []
    for center, size, heading in zip(boxes.centers, boxes.sizes, boxes.headings, strict=True):
        cos, sin = math.cos(heading), math.sin(heading)
        local = (points - center) @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        counts.append(int((np.abs(local) <= size / 2 + slack).all(axis=1).sum()))
    return np.array(counts, dtype=np.int64)


@pytest.mark.parametrize("seed", range(12))
def test_points_lie_on_the_boxes_that_samples_count_them_for(
    world: FactoryWorld, seed: int
) -> None:
    sample = draw(world, np.random.default_rng(seed), 45.0)
    assert sample.hits.shape == (len(sample.clouds), len(sample.boxes))
    assert 1 <= len(sample.clouds) <= 5
    for cloud, hits in zip(sample.clouds, sample.hits, strict=True):
        assert cloud.dtype == np.float32
        counted = on_boxes(cloud, sample.boxes, 0.5)
        # Noise of poses and of coded points may carry a few past the slack.
        assert (counted >= 0.9 * hits - 1).all()


def test_samples_are_of_all_three_forms(world: FactoryWorld) -> None:
    samples = [draw(world, np.random.default_rng(seed), 45.0) for seed in range(12)]
    single = [len(sample.clouds[0]) for sample in samples if len(sample.clouds) == 1]
    assert any(len(sample.clouds) > 1 for sample in samples)
    assert max(single) > 1.3 * min(single)


def test_the_same_draw_is_the_same_sample(world: FactoryWorld) -> None:
    again = FactoryWorld(robots=4, seed=5000)
    first, second = (draw(w, np.random.default_rng(3), 45.0) for w in (world, again))
    assert np.array_equal(first.boxes.centers, second.boxes.centers)
    assert np.array_equal(first.hits, second.hits)
    for a, b in zip(first.clouds, second.clouds, strict=True):
        assert np.array_equal(a, b)
