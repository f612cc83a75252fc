"""Policies as an ego runs them: what a drive's figures are, and the default beside its controls."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from coadapt.main import main
from network_controller.profiles import Fixed
from perception.detector.weight_files import has_weights
from perception.types import Boxes
from research.evaluation.ways.drive import Drive, Driven
from research.evaluation.ways.driven import (
    ADVISED,
    CONTROLS,
    DEFAULT,
    EVERYONE,
    POLICIES,
    Brought,
    brought,
    compare,
    table,
)
from research.evaluation.ways.going import gone
from research.evaluation.ways.measure import Measured
from research.evaluation.ways.planned import Decided
from research.evaluation.ways.way import Way
from research.evaluation.windows.links import Link
from research.evaluation.windows.scenarios import chosen, factory_suite
from swarm.errors import EvaluationError

needs_weights = pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train")
PLAIN = Brought(0.9, 0.8, 0.85, 10, 0.1, 1000.0, 4.0, 30.0, 1.0, 1.0, 0.0, 0.9)


def boxes(*places: float) -> Boxes:
    n = len(places)
    centers = np.column_stack([places, np.zeros(n), np.zeros(n)]) if n else np.zeros((0, 3))
    return Boxes(centers, np.ones((n, 3)), np.zeros(n), np.ones(n), ("person",) * n)


def test_figures_of_a_drive_count_skipped_frames_and_what_was_asked_for() -> None:
    one = Measured(bytes=600, wanted_bytes=800, asked=8, came=6, taking_part=4, due=4, ego_ms=60.0)
    for _ in range(2):
        known = boxes(0.0, 5.0), boxes(0.0, 5.0, 9.0)
        one.tally.add(boxes(0.0), boxes(0.0, 9.0), [300], known)
    found = brought(one, 10.0, 40_000.0)
    assert (found.ap_70, found.ap_70_with_known) == (0.5, pytest.approx(2 / 3))
    assert found.bytes_per_frame == 150.0
    assert found.participants == 3.0
    assert (found.ego_ms_per_frame, found.in_time_ratio, found.fused_ratio) == (30.0, 0.75, 0.5)
    assert found.infeasible == 0.0, "32 kbit/s of two frames at 10 Hz"
    assert brought(one, 10.0, 31_000.0).infeasible == 1.0


def test_the_default_stands_beside_its_controls_in_pairs() -> None:
    better = dataclasses.replace(PLAIN, ap_70=0.85, bytes_per_frame=500.0)
    drive = [better if policy.name == DEFAULT else PLAIN for policy in POLICIES]
    found = table([drive, drive])
    assert found["drives"] == 2
    assert [one["control"] for one in found["beside"]] == [*CONTROLS]
    everyone = found["beside"][0]
    assert everyone["difference"] == pytest.approx(0.05)
    assert everyone["interval"] == [pytest.approx(0.05), pytest.approx(0.05)]
    assert everyone["bytes_ratio"] == 0.5
    blind = [dataclasses.replace(one, ground_truth=0) for one in drive]
    assert table([drive, blind])["drives"] == 1
    with pytest.raises(EvaluationError, match="true box"):
        table([blind])


def test_a_model_and_its_control_stand_beside_the_default_where_they_were_driven() -> None:
    policies = POLICIES + ADVISED
    found = table([[PLAIN] * len(policies)], policies)
    assert [row["policy"] for row in found["rows"]] == [policy.name for policy in policies]
    controls = [one["control"] for one in found["beside"]]
    assert controls == [*CONTROLS, *(policy.name for policy in ADVISED)]


@needs_weights
def test_a_link_that_carries_little_brings_little_in_time() -> None:
    driven = Driven(Drive("factory", 1_960_000, 3, 0, 60, 6))

    def over(bps: int) -> list[int]:
        way = Way("everyone", (("early", 10.0),), link=Link("cell", Fixed(bps)))
        return [len(one.came) for one in gone(driven, way) if one is not None]

    assert over(50_000_000) == [2] * 6
    assert sum(over(100_000)) < 6


@needs_weights
def test_rules_ask_whom_decisions_could_ask(monkeypatch: pytest.MonkeyPatch) -> None:
    driven = Driven(Drive("factory", 1_960_000, 3, 0, 60, 6))
    near, far = driven.nearest

    def ask(way: Way) -> set[str]:
        return {robot for one in gone(driven, way) if one is not None for robot in one.came}

    rule = Way("rule", (("early", 10.0),))
    assert ask(rule) == {near, far}
    here = driven.world.pose(driven.ego, 60)
    reach_m = driven.world.pose(far, 60).distance_to(here) - 1.0
    monkeypatch.setattr(driven, "comm_range_m", reach_m)
    decided = Decided("static-early", validated=False)
    link = Link("cell", Fixed(50_000_000))
    assert ask(rule) == ask(Way("decided", link=link, decided=decided)) == {near}
    assert {one.taking_part for one in gone(driven, rule) if one is not None} == {1}


@needs_weights
def test_a_scenario_is_driven_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (whole,) = chosen(factory_suite(), ["blind-spot"])
    short = dataclasses.replace(whole, robots=3, window_frames=4)
    first = compare([short], 1, tmp_path)
    rows = {row["policy"]: row for row in first["rows"]}
    assert [*rows] == [policy.name for policy in POLICIES]
    assert rows["nobody"]["bytes_per_frame"] == 0.0
    assert 0.0 < rows[DEFAULT]["bytes_per_frame"] <= rows[EVERYONE]["bytes_per_frame"]
    assert rows[EVERYONE]["in_time_ratio"] > 0.0
    assert json.loads((tmp_path / "driven.json").read_text())["rows"] == first["rows"]
    assert DEFAULT in (tmp_path / "driven.md").read_text()
    assert "driven:" in capsys.readouterr().err
    assert compare([short], 1, tmp_path) == first
    assert "driven:" not in capsys.readouterr().err, "it was kept"


def test_an_unknown_scenario_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["eval", "driven", "--scenarios", "moon", "--output", str(tmp_path)]) == 1
    assert "scenario 'moon' is not known" in capsys.readouterr().err
