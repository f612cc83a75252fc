"""The oracle of assignments: what it searches among, and how it is judged."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from network_controller.profiles import Fixed
from perception.detector.weight_files import has_weights
from research.evaluation.ways.drive import Drive, Driven
from research.evaluation.ways.driven import DEFAULT
from research.evaluation.ways.oracle import (
    HELD_OUT,
    ORACLE,
    POLICIES,
    Trial,
    Value,
    climb,
    compare,
    sendable,
    table,
)
from research.evaluation.windows.links import Link
from research.evaluation.windows.scenarios import chosen, factory_suite
from swarm.errors import EvaluationError

needs_weights = pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train")


def test_what_a_robot_may_send_is_what_an_ego_may_ask_for() -> None:
    found = [*sendable("R1", "factory")]
    assert {one.algorithm for one in found} == {"early", "late"}
    assert {one.rate_hz for one in found if one.algorithm == "late"} == {10.0, 5.0, 2.0, 1.0, 0.5}
    asked = {one.rate_hz: one.places_hz for one in found if one.algorithm == "early"}
    assert asked == {10.0: 0.0, 5.0: 10.0, 2.0: 10.0, 1.0: 5.0, 0.5: 5.0}
    assert {one.rate_hz for one in found if one.objects_only} == {5.0, 2.0}
    assert not any(one.objects_only for one in sendable("R1", "road"))


def test_rows_stand_beside_the_default_in_pairs_of_drives() -> None:
    plain, better = Value(0.8, 0.7, 1000.0), Value(0.9, 0.85, 500.0)
    drive = {row: [plain, plain] for row in (*POLICIES, ORACLE)}
    drive[HELD_OUT] = [better, plain]
    found = table([drive, drive])
    rows = {row["policy"]: row for row in found["rows"]}
    assert rows[HELD_OUT]["ap_70"] == pytest.approx(0.85)
    assert rows[HELD_OUT]["value_beside"] == [pytest.approx(0.075)] * 3
    assert rows[ORACLE]["value_beside"] == rows[DEFAULT]["ap_70_beside"] == [0.0, 0.0, 0.0]
    with pytest.raises(EvaluationError, match="true box"):
        table([])


@needs_weights
def test_the_search_keeps_what_is_better_by_its_half(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("research.evaluation.ways.oracle.PROBES", 3)
    driven = Driven(Drive("factory", 1_960_000, 3, 0, 60, 16))
    trial = Trial(driven, Link("cell", Fixed(50_000_000)), 0.0, 50e6)
    nobody = trial.fixed(())
    assert nobody is not None, "a half without true boxes"
    assert nobody.whole.bytes_per_frame == 0.0
    assert nobody.whole.value == nobody.whole.ap_70
    top = climb(trial, [()], 0, seed=1)
    assert trial.measured[top].halves[0].value >= nobody.halves[0].value
    assert top == climb(trial, [()], 0, seed=1)
    assert 1 < len(trial.measured) <= 4
    narrow = Trial(driven, Link("cell", Fixed(1000)), 0.0, 1000.0)
    assert climb(narrow, [()], 0, seed=1) == (), "a link that carries nobody"


@needs_weights
def test_a_scenario_is_searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("research.evaluation.ways.oracle.PROBES", 2)
    (whole,) = chosen(factory_suite(), ["blind-spot"])
    short = dataclasses.replace(whole, robots=3, window_frames=8)
    found = compare([short], 1, tmp_path)
    rows = {row["policy"]: row for row in found["rows"]}
    assert [*rows] == [*POLICIES, ORACLE, HELD_OUT]
    assert json.loads((tmp_path / "oracle.json").read_text())["rows"] == found["rows"]
    assert HELD_OUT in (tmp_path / "oracle.md").read_text()
