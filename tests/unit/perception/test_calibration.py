"""Calibrated scores and the operating point: what a detector publishes."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from perception.detector import calibration
from perception.detector.calibration import (
    ALONE,
    Calibration,
    Curve,
    calibration_of,
    digest_of,
    read_calibration,
    uncalibrated,
)
from perception.detector.weight_files import weight_file
from perception.fusion.publishing import operating_point
from perception.types import Boxes
from swarm.errors import PerceptionError

CURVE = Curve(
    offset=-1.0, slope=2.0, helpers=0.5, precision=0.9, recall=0.9, false_per_frame=0.1,
    calibration_error=0.01, frames=10,
)  # fmt: skip
MADE = Calibration(
    detector="factory", weights="", least_chance=0.25, curves={ALONE: CURVE, "early": CURVE}
)


def found(*scores: float) -> Boxes:
    count = len(scores)
    places = np.arange(3.0 * count).reshape(count, 3)
    sizes, labels = np.ones((count, 3)), ("person",) * count
    return Boxes(places, sizes, np.zeros(count), np.array(scores), labels)


def test_a_chance_rises_with_the_score_and_with_those_who_saw() -> None:
    scores = np.array([0.0, 0.1, 0.5, 0.9, 1.0])
    chance = CURVE.chance(scores, 3)
    assert (np.diff(chance) > 0).all()
    assert ((chance > 0) & (chance < 1)).all()
    assert (chance > CURVE.chance(scores, 0)).all()
    assert CURVE.chance(np.array([0.5]), 0)[0] == pytest.approx(1 / (1 + np.e))


def test_what_is_likely_there_is_published_best_first() -> None:
    published = MADE.published(found(0.2, 0.9, 0.6, 0.4), "early", 2)
    assert published.centers[:, 0].tolist() == [3.0, 6.0]
    assert published.scores == pytest.approx(CURVE.chance(np.array([0.9, 0.6]), 2))
    assert published.scores.min() >= MADE.least_chance


def test_without_helpers_the_ego_s_own_curve_counts() -> None:
    other = msgspec.structs.replace(CURVE, offset=-9.0)
    alone = msgspec.structs.replace(MADE, curves={ALONE: other, "early": CURVE})
    assert len(alone.published(found(0.9), "early", 0)) == 0
    assert len(alone.published(found(0.9), "early", 1)) == 1


def test_an_algorithm_that_nobody_calibrated_keeps_all_its_boxes_and_scores() -> None:
    for made in (MADE, uncalibrated("factory")):
        assert made.published(found(0.1, 0.9), "mine", 2).scores.tolist() == [0.1, 0.9]


def test_a_detector_whose_calibration_is_gone_publishes_as_one_that_nobody_calibrated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibration, "calibration_file", lambda _: tmp_path / "gone.json")
    made = calibration.calibration_of.__wrapped__("factory")
    assert made == uncalibrated("factory")


@pytest.mark.parametrize("detector", ["factory", "road"])
def test_what_comes_with_the_project_is_calibrated(detector: str) -> None:
    made = calibration_of(detector)
    assert made.curves
    assert ALONE in made.curves
    for name, curve in made.curves.items():
        assert curve.calibration_error <= 0.05, name
        assert sum(count for _, _, count in curve.reliability) > 100


def test_a_calibration_of_other_weights_is_refused_and_says_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    path.write_bytes(msgspec.json.encode(MADE))
    with pytest.raises(PerceptionError, match=r"other weights than .*--calibrate"):
        read_calibration(path, "factory", weight_file("factory"))
    fitting = msgspec.structs.replace(MADE, weights=digest_of(weight_file("factory")))
    path.write_bytes(msgspec.json.encode(fitting))
    assert read_calibration(path, "factory", weight_file("factory")) == fitting
    with pytest.raises(PerceptionError, match="other weights"):
        read_calibration(path, "road", weight_file("factory"))


@pytest.mark.parametrize(
    "change",
    [{"least_chance": 2.0}, {"curves": {"early": {"slope": -1}}}, {"curves": {}}, {"more": 1}],
)
def test_a_file_that_is_none_is_refused(tmp_path: Path, change: dict[str, object]) -> None:
    path = tmp_path / "c.json"
    path.write_bytes(msgspec.json.encode({**msgspec.to_builtins(MADE), **change}))
    with pytest.raises(PerceptionError, match=r"c\.json cannot be used"):
        read_calibration(path, "factory", weight_file("factory"))


def test_the_operating_point_is_told_of_what_is_calibrated_alone() -> None:
    assert operating_point("factory", "early") == calibration_of("factory").least_chance
    assert operating_point("factory", "an-algorithm-of-ones-own") is None
