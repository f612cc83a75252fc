"""What rarer contributions are worth: falls with the time between two, by algorithm."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import PLACES_HZ, RARER_HZ
from ego_agent.knowledge.rates import RateModel, packaged_rates, rates_of, read_rates
from research.evaluation.ways.sampling import BETWEEN_HZ
from swarm.errors import DecisionError

TABLE = {"10": 1.0, "5": 0.9, "1": 0.5}
WORTH = {"by_algorithm": {"intermediate": TABLE}}


def test_worth_is_that_of_the_table_and_linear_in_the_time_between() -> None:
    model = RateModel({"intermediate": TABLE})
    assert model.worth("intermediate", 5.0) == pytest.approx(0.9)
    assert model.worth("intermediate", 1 / 0.6) == pytest.approx(0.7)
    assert model.worth("intermediate", 20.0) == 1.0
    assert model.worth("intermediate", 0.5) == 0.0
    assert model.worth("unmeasured", 1.0) == pytest.approx(0.5)
    assert model.kept("intermediate", 1.0, 5.0) == pytest.approx(0.5 / 0.9)
    assert model.kept("intermediate", 5.0, 1.0) == 1.0


def test_what_is_often_contributed_need_not_suffice() -> None:
    model = RateModel({"intermediate": {"10": 0.8, "1": 0.4}})
    assert model.convinces("intermediate") == model.worth("intermediate", 10.0) == 0.8
    assert model.kept("intermediate", 1.0, 10.0) == pytest.approx(0.5)


def test_with_places_in_between_rarer_contributions_keep_more() -> None:
    tables, places = {"intermediate": TABLE, "early": TABLE}, {"early": {"2": 0.9, "1": 0.8}}
    model = RateModel(tables, places, {"2": 10.0, "1": 5.0})
    often = [model.between_hz("early", hz) for hz in (3.0, 2.0, 1.5, 1.0, 0.5)]
    assert often == [0.0, 10.0, 10.0, 5.0, 0.0]
    assert model.between_hz("intermediate", 1.0) == 0.0
    assert RateModel(tables).between_hz("early", 1.0) == 0.0
    assert model.kept("early", 1.0, 10.0) == pytest.approx(0.5)
    assert model.kept("early", 1.0, 10.0, 5.0) == pytest.approx(0.8)
    assert model.kept("early", 0.5, 10.0, 5.0) == 0.0
    assert model.kept("intermediate", 1.0, 10.0, 5.0) == pytest.approx(0.5)


def test_places_asked_about_less_often_than_was_measured_add_less() -> None:
    model = RateModel({"intermediate": TABLE, "early": TABLE}, {"early": {"1": 0.9}}, {"1": 5.0})
    kept = [model.kept("early", 1.0, 10.0, hz) for hz in (0.0, 1.0, 2.0, 3.0, 5.0, 10.0)]
    assert kept == pytest.approx([0.5, 0.5, 0.6, 0.7, 0.9, 0.9])


def test_the_packaged_law_asks_as_often_as_was_measured() -> None:
    for detector, between_hz in BETWEEN_HZ.items():
        model = rates_of(detector)
        assert {hz: model.between_hz("early", hz) for hz in between_hz} == between_hz
    known = Knowledge.of_detector("road", Objective(rarer_hz=RARER_HZ, places_hz=PLACES_HZ))
    assert [known.places_hz("early", hz) for hz in RARER_HZ] == [0.0, 5.0, 5.0, 5.0]
    assert known.places_hz("late", 1.0) == 0.0


@pytest.mark.parametrize("detector", ["factory", "road"])
def test_the_packaged_law_knows_what_places_are_worth(detector: str) -> None:
    model = rates_of(detector)
    rates = sorted(BETWEEN_HZ[detector], reverse=True)
    kept = [model.kept("early", hz, 10.0, 10.0) for hz in rates]
    assert kept == sorted(kept, reverse=True)
    assert all(more > model.kept("early", hz, 10.0) for more, hz in zip(kept, rates, strict=True))


@pytest.mark.parametrize("detector", ["factory", "road"])
def test_the_packaged_law_falls_with_the_rate(detector: str) -> None:
    model = rates_of(detector)
    for algorithm in ("early", "intermediate", "late"):
        worth = [model.worth(algorithm, hz) for hz in (10.0, 5.0, 2.0, 1.0, 0.5)]
        assert worth[0] == model.convinces(algorithm) > 0.6
        assert worth == sorted(worth, reverse=True)
        assert worth[-1] < 0.7


def test_a_detector_that_was_not_measured_counts_as_the_factory() -> None:
    assert rates_of("elsewhere") is packaged_rates()["factory"]


@pytest.mark.parametrize(
    "text",
    [
        "nonsense",
        "{}",
        json.dumps({"factory": {}}),
        json.dumps({"factory": {"intermediate": TABLE}}),
        json.dumps({"factory": {"by_algorithm": {}}}),
        json.dumps({"factory": {"by_algorithm": {"intermediate": {"10": 2.0}}}}),
        json.dumps({"factory": WORTH, "road": {"by_algorithm": {"early": TABLE}}}),
        json.dumps({"factory": WORTH | {"with_places": {"early": {"1": 0.9}}}}),
        json.dumps({"factory": WORTH | {"places_hz": {"1": 0.0}}}),
    ],
)
def test_what_is_no_law_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rates.json"
    path.write_text(text)
    with pytest.raises(DecisionError, match="rates"):
        read_rates(path)


def test_a_law_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DecisionError, match="no model of rates"):
        read_rates(tmp_path / "none.json")
