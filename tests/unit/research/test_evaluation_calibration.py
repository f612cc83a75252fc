"""Fitting a detector's calibration: known chances are found again."""

from __future__ import annotations

import numpy as np
import pytest

from perception.metrics import Match
from research.evaluation.calibration import LEAST_CHANCE, Seen, curve_of
from swarm.errors import PerceptionError


def seen(rng: np.random.Generator, helpers: int, boxes: int = 400) -> Seen:
    """A frame in which a box of score s is right with the chance that a known curve tells."""
    scores = np.sort(rng.uniform(0.02, 0.98, boxes))[::-1]
    logit = -1.0 + 2.0 * np.log(scores / (1 - scores)) + 0.5 * np.log1p(helpers)
    hits = rng.random(boxes) < 1 / (1 + np.exp(-logit))
    return Seen("early", helpers, Match(scores, hits, int(hits.sum()) + 10))


def test_the_curve_that_made_the_boxes_is_found() -> None:
    rng = np.random.default_rng(1)
    worlds = [[seen(rng, helpers) for helpers in (1, 3, 5)] for _ in range(20)]
    curve = curve_of(worlds)
    assert curve.offset == pytest.approx(-1.0, abs=0.15)
    assert curve.slope == pytest.approx(2.0, abs=0.1)
    assert curve.helpers == pytest.approx(0.5, abs=0.12)
    assert curve.calibration_error < 0.02
    assert curve.frames == 60
    right = sum(int(one.match.hits.sum()) for world in worlds for one in world)
    truths = right + 60 * 10
    assert 0.8 * right / truths < curve.recall <= right / truths
    assert all(told >= LEAST_CHANCE for told, _, _ in curve.reliability)


def test_scores_that_say_nothing_are_told_as_what_is_usual() -> None:
    rng = np.random.default_rng(2)
    worlds = []
    for _ in range(10):
        scores = np.sort(rng.uniform(0.1, 0.9, 300))[::-1]
        worlds.append([Seen("early", 1, Match(scores, rng.random(300) < 0.6, 180))])
    curve = curve_of(worlds)
    assert curve.chance(np.array([0.2, 0.8]), 1) == pytest.approx([0.6, 0.6], abs=0.06)


NOTHING = Match(np.zeros(0), np.zeros(0, np.bool_), 3)


@pytest.mark.parametrize("frames", [[], [Seen("early", 1, NOTHING)]])
def test_nothing_found_cannot_be_calibrated(frames: list[Seen]) -> None:
    with pytest.raises(PerceptionError, match="nothing to calibrate"):
        curve_of([frames])
