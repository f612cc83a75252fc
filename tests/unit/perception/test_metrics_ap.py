"""Average precision on cases that can be computed by hand."""

from __future__ import annotations

import pytest

from perception.metrics import average_precision, average_precision_per_frame
from perception.types import Boxes
from tests.unit.perception.test_boxes import make

CAR = (0, 0, 0, 4, 2, 1, 0.0)
FAR = (30, 0, 0, 4, 2, 1, 0.0)
NOTHING = (60, 0, 0, 4, 2, 1, 0.0)


def test_perfect_detections_have_precision_one() -> None:
    truth = make(CAR, FAR)
    assert average_precision([(make(CAR, FAR), truth)], 0.7) == pytest.approx(1.0)


def test_a_false_alarm_above_a_hit_costs_its_share() -> None:
    found = make(NOTHING, CAR, scores=[0.9, 0.8])
    assert average_precision([(found, make(CAR))], 0.5) == pytest.approx(0.5)


def test_a_missed_box_limits_the_recall() -> None:
    assert average_precision([(make(CAR), make(CAR, FAR))], 0.5) == pytest.approx(0.5)


def test_the_second_box_on_one_object_is_a_false_alarm() -> None:
    found = make(CAR, CAR, FAR, scores=[0.9, 0.8, 0.7])
    # Ranks: hit (1/1), duplicate (1/2), hit (2/3): 0.5 * 1 + 0.5 * 2/3.
    assert average_precision([(found, make(CAR, FAR))], 0.5) == pytest.approx(0.5 + 1 / 3)


def test_scores_are_ranked_over_all_frames() -> None:
    good = (make(CAR, scores=[0.9]), make(CAR))
    bad = (make(NOTHING, scores=[0.95]), make(CAR))
    assert average_precision([good, bad], 0.5) == pytest.approx(0.25)


def test_without_truth_or_detections_it_is_zero() -> None:
    assert average_precision([(make(CAR), Boxes.empty())], 0.5) == 0.0
    assert average_precision([(Boxes.empty(), make(CAR))], 0.5) == 0.0


def test_the_per_frame_variant_ranks_within_frames_only() -> None:
    # First frame: a hit, then a weak false alarm. Second frame: a hit that scores between them.
    first = (make(CAR, NOTHING, scores=[0.9, 0.1]), make(CAR))
    second = (make(CAR, scores=[0.5]), make(CAR))
    # All by score: hit, hit, false. Frame by frame: hit, false, hit: 0.5 * 1 + 0.5 * 2/3.
    assert average_precision([first, second], 0.5) == pytest.approx(1.0)
    assert average_precision_per_frame([first, second], 0.5) == pytest.approx(0.5 + 1 / 3)
    assert average_precision_per_frame([second, first], 0.5) == pytest.approx(1.0)


def test_the_per_frame_variant_ranks_a_frame_by_score() -> None:
    found = make(CAR, NOTHING, scores=[0.8, 0.9])
    assert average_precision_per_frame([(found, make(CAR))], 0.5) == pytest.approx(0.5)
    assert average_precision_per_frame([(Boxes.empty(), Boxes.empty())], 0.5) == 0.0
