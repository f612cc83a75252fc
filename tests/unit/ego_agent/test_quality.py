"""Q as a precision, and what a choice costs in shares of link and processors."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from ego_agent.knowledge.answers import AnswerTimes
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.compute import Work
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.quality import QualityModel, packaged_quality, quality_of, read_quality
from ego_agent.plan.choices.scoring import Scorer
from perception.fusion.registry import fusion_names
from swarm.errors import DecisionError
from swarm.geometry import Pose
from tests.support.ego_scenes import candidate, scene
from worlds.cooperative.judging import EVALUATION_RANGES_M

MODEL = QualityModel(
    base=0.3, own=0.4, gains={"early": 0.6, "intermediate": 0.5}, enough=0.9, calibrated=True
)


def test_what_participants_add_gains_up_to_what_is_enough() -> None:
    assert MODEL.quality("early", 0.5, 0.5) == pytest.approx(0.5)
    assert MODEL.quality("early", 0.5, 0.8) == pytest.approx(0.5 + 0.6 * 0.3)
    assert MODEL.quality("early", 0.5, 0.95) == MODEL.quality("early", 0.5, 0.9)
    assert MODEL.quality("early", 1.0, 1.0) == pytest.approx(0.3 + 0.4 * 0.9)
    assert MODEL.quality("telepathy", 0.5, 0.8) == MODEL.quality("intermediate", 0.5, 0.8)


def test_a_blind_ego_expects_nothing() -> None:
    known = Knowledge(quality=MODEL)
    blind = scene(candidate("E"), excluded={"E": "its beacon is old"})
    assert Scorer(blind, known).score((), "early").quality == 0.0
    sees = scene(candidate("E", range(9)))
    assert Scorer(sees, known).score((), "early").quality == pytest.approx(0.3 + 0.4 * 0.9)
    half = dataclasses.replace(sees, unknown=1, candidates=(candidate("A"),))
    assert Scorer(half, known).score((), "early").quality < 0.6


def test_without_figures_quality_is_the_share() -> None:
    model = quality_of("a-detector-of-ones-own")
    assert not model.calibrated
    assert model.quality("early", 0.2, 0.7) == pytest.approx(0.7)
    assert model.counts(np.array([[1e6, 0.0]]), 0.0).all()


def test_every_detector_with_figures_has_them_for_all_its_algorithms() -> None:
    models = packaged_quality()
    assert set(models) == {"factory", "road"}
    for detector, model in models.items():
        assert model.calibrated
        assert set(model.gains) == set(fusion_names(detector))
        assert model.half_m == EVALUATION_RANGES_M[detector], "where precision is measured"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "Expected `object`"),
        ('{"factory": {"base": 2}}', "<= 1.0"),
        ('{"factory": {"enough": 0}}', "> 0.0"),
        ('{"factory": {"basis": 1}}', "unknown field `basis`"),
    ],
)
def test_a_file_that_holds_something_else_is_refused(
    text: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "quality.json"
    path.write_text(text)
    with pytest.raises(DecisionError, match=message):
        read_quality(path)
    with pytest.raises(DecisionError, match="cannot be read: No such file"):
        read_quality(tmp_path / "none.json")


def test_only_what_lies_in_the_detectors_area_counts_along_the_egos_own_axes() -> None:
    model = QualityModel(half_m=(4.0, 1.0))
    ahead = np.array([[3.0, 0.0], [0.0, 3.0]])
    assert model.counts(ahead, 0.0).tolist() == [True, False]
    assert model.counts(ahead, math.pi / 2).tolist() == [False, True]
    # The grid has 8 x 8 cells around the ego: R sees a row that does not count, S one that does.
    far, near = candidate("R", range(8)), candidate("S", range(24, 32))
    ego = dataclasses.replace(candidate("E"), pose=Pose(0.0, 0.0, 0.0))
    scorer = Scorer(scene(ego, far, near), Knowledge(quality=model))
    assert scorer.share([scorer.row_of["R"]]) == 0.0
    assert scorer.share([scorer.row_of["S"]]) == 1.0


def test_a_choice_costs_tenths_of_the_cell_and_of_processors() -> None:
    objective = Objective(lambda_link=0.01, lambda_compute=0.02)
    # A fifth of the link, and a tenth of a processor.
    assert objective.cost(25_000, 10e6, 0.01, 10.0) == pytest.approx(2 * 0.01 + 0.02)
    beside = Objective(lambda_link=0.0, lambda_compute=0.0, lambda_cost=2.0)
    assert beside.cost(500_000, 10e6, 0.01, 10.0) == pytest.approx(1.0)


def test_who_encodes_slowly_costs_more() -> None:
    works = {"early": Work(encode_ms=3.0, fixed_ms=20.0, add_ms=2.0)}
    slow = dataclasses.replace(
        candidate("B", range(30, 50)), answers={"early": AnswerTimes(encode_s=0.2, work_s=0.05)}
    )
    found = scene(candidate("E", range(10)), candidate("A", range(10, 30)), slow)
    known = Knowledge(Objective(lambda_link=0.0), works=works)
    scorer = Scorer(found, known)
    assert scorer.price(scorer.row_of["A"], "early") == pytest.approx(0.02 * 10 * 10 * 0.005)
    assert scorer.price(scorer.row_of["B"], "early") == pytest.approx(0.02 * 10 * 10 * 0.052)
    known.own_costs.record("early", 2, 0.02, 0.08, 0.02)
    scorer = Scorer(found, known)
    assert scorer.price(scorer.row_of["A"], "early") == pytest.approx(0.02 * 10 * 10 * 0.013)
    both = scorer.score(("A", "B"), "early")
    assert both.cost == pytest.approx(scorer.cost(("A", "B"), "early"))
    assert both.value == pytest.approx(both.quality - both.cost)
