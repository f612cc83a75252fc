"""`coadapt eval policies`: the same windows for all, its files, and how it is interrupted."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from coadapt.main import main
from ego_agent.knowledge.compute import packaged_compute, read_compute
from ego_agent.knowledge.model import Proposal
from ego_agent.knowledge.objective import Objective
from network_controller.profiles import Fixed
from perception.fusion.registry import fusion_names
from research.evaluation.bootstrap import bootstrap_mean
from research.evaluation.policies.claims import claims_of
from research.evaluation.policies.decide import Decided, decisions, policy_of
from research.evaluation.policies.results import ORACLE, means_of, rows_of
from research.evaluation.policies.work_items import Outcomes, knowledge_of
from research.evaluation.published import EVAL_COLUMNS, SELECTION_COLUMNS
from research.evaluation.windows import announcements, links
from research.evaluation.windows.choice import ALONE, Choice, Delivered, Outcome
from research.evaluation.windows.measure import Window
from research.evaluation.windows.scenarios import Expectation, Scenario, factory_suite
from research.training.plans import TEST_SEEDS
from swarm.errors import EvaluationError

pytestmark = pytest.mark.slow

SCENARIO = Scenario("small", 4, links.shift(), TEST_SEEDS.start + 555_556, windows=2)
ALGORITHMS = fusion_names("factory")
KNOWLEDGE = knowledge_of(ALGORITHMS, SCENARIO)


def outcome(ap_70: float, size: float, truths: int = 20) -> Outcome:
    return Outcome(ap_70, ap_70, ap_70, size, 4, truths, (ap_70, ap_70))


def decided(policy: str, choice: Choice, window: int = 0) -> Decided:
    return Decided(
        "small", window, ("R1", "R2", "R3", "R4"), "R1", ("R2", "R3", "R4"), policy, choice,
        round(1e3), "because", "policy", 0.002,
    )  # fmt: skip


def test_a_blind_policy_is_measured_as_it_is_and_others_as_an_ego_would_have_them() -> None:
    window = Window(SCENARIO, 0)
    fusions = {name: window.fusion(name) for name in KNOWLEDGE.algorithms}
    messages = announcements.heard(window.world, 0, window.ego, dict(fusions))
    narrow = replace(SCENARIO, link=links.Link("thin", Fixed(2_000_000)))
    found = {
        name: decisions(narrow, [messages], KNOWLEDGE, policy_of(name, narrow, KNOWLEDGE))[0]
        for name in ("static-intermediate", "coverage", "random")
    }
    assert found["static-intermediate"].choice == Choice(("R2", "R3", "R4"), "intermediate")
    assert found["static-intermediate"].predicted_bytes > 25_000
    assert 0 < found["coverage"].predicted_bytes <= Objective().budget_bytes(2e6)
    assert found["coverage"].in_range == ("R2", "R3", "R4") or set(found["coverage"].in_range) == {
        "R2",
        "R3",
        "R4",
    }
    again = decisions(narrow, [messages], KNOWLEDGE, policy_of("random", narrow, KNOWLEDGE))[0]
    assert again.choice == found["random"].choice


def test_regret_savings_and_infeasible_windows() -> None:
    everyone, two, alone = (
        Choice(("R2", "R3", "R4"), "early"), Choice(("R2",), "early"), Choice((), ALONE),
    )  # fmt: skip
    known: Outcomes = {
        everyone: outcome(0.9, 12_000), two: outcome(0.89, 4_000), alone: outcome(0.4, 0),
    }  # fmt: skip
    # What the link does not carry leaves the ego alone, at a cost all the same.
    nothing = Delivered(0.4, (0.4, 0.4), 100_000, 25.0, 0.0, 20e6, 0.0, 0.5)
    thin = {**known, everyone: replace(outcome(0.9, 1_000_000), delivered=nothing)}
    empty = {choice: replace(one, ground_truth=0) for choice, one in known.items()}
    choices = [("static-early", everyone), ("coverage", two)]
    all_decided = [decided(name, choice, w) for w in (0, 1, 2) for name, choice in choices]
    rows = rows_of(
        {"small": replace(SCENARIO, windows=3)},
        all_decided,
        {("small", 0): known, ("small", 1): thin, ("small", 2): empty},
        ALGORITHMS,
    )
    means = {one.policy: one for one in means_of(rows)}
    assert set(means) == {"static-early", "coverage", ORACLE}
    assert {one.windows for one in means.values()} == {2}, "a window without true boxes is none"
    assert means[ORACLE].regret_mean == 0
    assert means["coverage"].regret_mean == pytest.approx(((0.9 - 0.89) + 0) / 2)
    assert means["coverage"].infeasible_ratio == 0
    assert means["static-early"].infeasible_ratio == 0.5
    static = means["static-early"]
    # 8 Mbit/s of 20 cost four tenths of the link, though little of it was of use.
    price = 4 * Objective().lambda_link
    assert static.regret_mean == pytest.approx((0 + 0.89 - (0.4 - price)) / 2)
    assert static.ap_70 == pytest.approx(0.9)
    assert static.delivered_ap_70 == pytest.approx((0.9 + 0.4) / 2)
    assert (static.in_time_ratio, static.fused_ratio) == (0.5, 0.75)
    assert static.ego_ms_per_frame == pytest.approx(25.0 / 2)
    assert means["coverage"].saved == pytest.approx(1 - 4_000 / 506_000)
    assert means["coverage"].lost_ap_70.mean == pytest.approx(-0.01)
    assert means["coverage"].participants_mean == 2
    claims = {claim["what"]: claim for claim in claims_of(list(means.values()), rows)}
    below = claims["coverage: AP@0.7 below the best static full participation"]
    assert not below["met"]
    assert below["value"] == pytest.approx(0.01)
    assert claims["coverage: share of its bytes saved"]["met"]
    assert claims["coverage: decision p99 up to 6 robots, ms"]["value"] == 2.0


def test_the_interval_holds_the_mean_and_narrows_with_more_values() -> None:
    few, many = bootstrap_mean([0.0, 1.0] * 5), bootstrap_mean([0.0, 1.0] * 500)
    assert few.low < few.mean == many.mean == 0.5 < few.high
    assert many.high - many.low < few.high - few.low
    assert bootstrap_mean([]).mean != bootstrap_mean([]).mean, "there is no mean of nothing"
    values = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0] * 5
    apart = bootstrap_mean(values)
    together = bootstrap_mean(values, [i // 3 for i in range(30)])
    assert together.high - together.low > 1.3 * (apart.high - apart.low)


@pytest.mark.parametrize(
    ("participants", "feasible", "met"),
    [
        (("R2", "R3"), True, True),
        (("R2", "R3"), False, False),
        (("R3",), True, False),
        (("R2", "R3", "R4"), True, False),
    ],
)
def test_expectations(participants: tuple[str, ...], feasible: bool, met: bool) -> None:
    wanted = Expectation("", wanted=frozenset({"R2"}), redundant=frozenset({"R3", "R4"}))
    assert wanted.met(participants, feasible) is met
    assert not Expectation("", somebody=True).met((), True)


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_command_writes_all_files_and_repeats_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = next(scenario.name for scenario in factory_suite() if scenario.robots == 3)
    options = ["eval", "policies", "--scenarios", name, "--workers", "2"]
    options += ["--policies", "static-late,random,coverage", "--output", str(tmp_path)]
    assert main(options) == 0
    assert "measured: 3/3 windows" in capsys.readouterr().err
    figures = ("participants", "positions", "strategy", "bytes-precision", "by-strategy", "regret")
    repeated = ("eval.csv", *(f"{figure}.svg" for figure in figures))
    first = {name: (tmp_path / name).read_text() for name in repeated}
    for figure in figures:
        assert len(list(ElementTree.parse(tmp_path / f"{figure}.svg").iter())) > 50
    assert "static-late" in (tmp_path / "report.md").read_text()
    selection, results = read(tmp_path / "selection.csv"), read(tmp_path / "eval.csv")
    assert tuple(selection[0])[: len(SELECTION_COLUMNS)] == SELECTION_COLUMNS
    assert tuple(results[0])[: len(EVAL_COLUMNS)] == EVAL_COLUMNS
    assert len(selection) == len(results) == 3 * 6
    for row in selection:
        assert row["ego_cav"] in row["selected_cavs"].split("|")
        assert set(row["selected_cavs"].split("|")) <= set(row["in_range_cavs"].split("|"))
        assert row["n_selected"] == str(len(row["selected_cavs"].split("|")))
    headline = json.loads((tmp_path / "headline.json").read_text())
    rows: dict[str, dict[str, Any]] = {row["policy"]: row for row in headline["rows"]}
    own_controls = {"coverage~random", "coverage~first"}
    assert set(rows) == {"static-late", "random", "coverage", "oracle", *own_controls}
    assert {one["control"] for one in headline["controls"]} == own_controls
    counted = {one["of"]: one for one in headline["bytes_as_published"]["policies"]}
    assert set(counted) == {"static-late", "random", "coverage", "oracle"}
    assert counted["coverage"]["bytes_per_frame"] == rows["coverage"]["bytes_per_frame"]
    assert counted["coverage"]["published_bytes_per_frame"] > 50_000
    assert "coverage~first" not in first["regret.svg"], "figures show policies only"
    assert rows["oracle"]["regret_mean"] == 0
    told = {"policy", "participants_mean", "bytes_per_frame", "delivered_ap_70"}
    assert all(told | {"ego_ms_per_frame", "in_time_ratio"} <= set(row) for row in rows.values())
    assert all(0 <= row["in_time_ratio"] <= 1 for row in rows.values())
    assert read_compute(tmp_path / "compute.json") == packaged_compute()
    assert rows["coverage"]["infeasible_ratio"] == 0
    assert all(row["regret_mean"] >= 0 for row in rows.values() if not row["infeasible_ratio"])

    slow = tmp_path / "slow.json"
    work = {"encode_ms": 1.0, "fixed_ms": 150.0, "add_ms": 0.0}
    model = {"machine": "slow", "detectors": {"factory": {"intermediate": work, "single": work}}}
    slow.write_text(json.dumps(model))
    assert main([*options, "--compute", str(slow)]) == 0
    slower = json.loads((tmp_path / "headline.json").read_text())["rows"]
    assert {row["ego_ms_per_frame"] for row in slower} == {150.0}
    assert read_compute(tmp_path / "compute.json").machine == "slow"
    capsys.readouterr()

    assert main(options) == 0
    assert "measured:" not in capsys.readouterr().err, "what was measured was measured again"
    for name, text in first.items():
        assert (tmp_path / name).read_text() == text, name
    again = json.loads((tmp_path / "headline.json").read_text())
    for row in again["rows"]:
        before = rows[row["policy"]]
        assert {k: v for k, v in row.items() if "_ms_" not in k} == {
            k: v for k, v in before.items() if "_ms_" not in k
        }


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--policies", "wish"], "policy 'wish' is unknown; allowed: coverage"),
        (
            ["--policies", "coverage,llm"],
            "policy 'llm' needs a language model: name it with --models",
        ),
        (["--algorithms", "magic"], "algorithm 'magic' is not available; allowed: early"),
        (["--prompt", "poem"], "prompt 'poem' is not known; allowed: table, paper"),
        (["--policies", ","], "there is nothing to compare"),
        (["--scenarios", "moon"], "scenario 'moon' is not known; allowed: redundant-cluster"),
        (["--compute", "nowhere"], "nowhere is no model of compute"),
        (["--data", "nowhere"], "data directory nowhere is not a readable directory"),
    ],
)
def test_what_cannot_be_compared_is_named(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["eval", "policies", *options, "--output", str(tmp_path)]) == 1
    assert words in capsys.readouterr().err
    assert not (tmp_path / "headline.json").exists()


def test_a_recorded_world_is_compared_likewise(opv2v_dir: Path, tmp_path: Path) -> None:
    name = "2021_09_03_09_32_17-302"
    options = ["--data", str(opv2v_dir), "--scenarios", name, "--policies", "static-late,coverage"]
    assert main(["eval", "policies", *options, "--output", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "headline.json").read_text())["rows"]
    assert {row["policy"] for row in rows} == {
        "static-late", "coverage", "coverage~random", "coverage~first", "oracle",
    }  # fmt: skip
    assert all(row["regret_mean"] >= -1e-6 for row in rows)
    with (tmp_path / "selection.csv").open(newline="") as file:
        assert {row["com_range_m"] for row in csv.DictReader(file)} == {"70.0"}


def test_a_policy_that_fails_is_no_coverage() -> None:
    window = Window(SCENARIO, 0)
    messages = announcements.heard(window.world, 0, window.ego, {"late": window.fusion("late")})

    class Broken:
        name = "broken"

        def propose(self, *_: object) -> Proposal:
            raise RuntimeError("no idea")

    with pytest.raises(EvaluationError, match=r"in small: .*broken failed with RuntimeError"):
        decisions(SCENARIO, [messages], KNOWLEDGE, Broken())


def test_a_killed_comparison_goes_on_where_it_was(tmp_path: Path) -> None:
    name = next(scenario.name for scenario in factory_suite() if scenario.robots == 3)
    options = ["--scenarios", name, "--policies", "static-late", "--algorithms", "late"]
    command = [sys.executable, "-m", "coadapt.main", "eval", "policies", *options]
    command += ["--workers", "1", "--output", str(tmp_path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as run:
        assert run.stderr is not None
        assert any("measured: 1/3 windows" in line for line in run.stderr)
        run.kill()
    assert not (tmp_path / "headline.json").exists()
    again = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=True)
    assert "messages:" not in again.stderr
    assert "measured: 2/2 windows" in again.stderr
    assert json.loads((tmp_path / "headline.json").read_text())["rows"][0]["windows"] == 3


def test_windows_without_a_true_box_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worlds.cooperative.judging.MIN_VISIBLE_POINTS", 1 << 30)
    window = Window(replace(SCENARIO, robots=3), 0)
    nothing = window.outcome(Choice((), ALONE))
    assert nothing.ground_truth == 0
    assert nothing.halves is None
    rows = rows_of(
        {"small": SCENARIO},
        [decided("coverage", Choice((), ALONE))],
        {("small", 0): {Choice((), ALONE): nothing}},
        ALGORITHMS,
    )
    assert not rows
