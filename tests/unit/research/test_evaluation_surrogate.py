"""Training of the surrogate: which windows, which choices, and that it learns."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from coadapt.main import main
from ego_agent.plan.surrogate.features import NAMES
from ego_agent.plan.surrogate.model import read_surrogate
from perception.fusion.registry import fusion_names
from research.evaluation.result_store import ResultStore
from research.evaluation.surrogate import measuring
from research.evaluation.surrogate import train as training
from research.evaluation.surrogate.errors import errors_of
from research.evaluation.surrogate.measuring import random_choices
from research.evaluation.surrogate.quality import Shares, fitted
from research.evaluation.surrogate.samples import Samples, other_settings, training_windows
from research.evaluation.windows.choice import ALONE, Choice, Outcome
from research.evaluation.windows.measure import Window
from research.evaluation.windows.scenarios import SUITE_SEEDS, SURROGATE_SEEDS
from research.training.plans import TEST_SEEDS
from worlds.factory.world import FactoryWorld

ALGORITHMS = fusion_names("factory")


def test_windows_mix_sizes_kinds_and_noise_on_floors_of_their_own() -> None:
    windows = training_windows(300)
    assert len({window.seed for window in windows}) == 300
    assert all(window.seed in SURROGATE_SEEDS for window in windows)
    assert not any(window.seed in SUITE_SEEDS for window in windows)
    assert all(window.seed in TEST_SEEDS for window in windows), "no detector has seen them"
    seen = Counter((window.robots, window.pose_noise_m > 0) for window in windows)
    assert min(seen.values()) >= 10, "every size with and without noise"
    assert len({window.kind for window in windows}) == 4
    assert all(window.ego < window.robots for window in windows)


@pytest.mark.parametrize(
    "candidates", [(), ("R2",), ("R2", "R3"), tuple(f"R{i}" for i in range(2, 40))]
)
def test_choices_are_different_and_the_same_each_time(candidates: tuple[str, ...]) -> None:
    choices = list(random_choices(candidates, ALGORITHMS, 5))
    assert choices == list(random_choices(candidates, ALGORITHMS, 5))
    assert len(set(choices)) == len(choices) <= measuring.CHOICES
    assert choices[0] == Choice((), ALONE)
    if candidates:
        assert {Choice(tuple(sorted(candidates)), name) for name in ALGORITHMS} <= set(choices)


@pytest.mark.slow
def test_it_learns_which_choice_of_a_window_is_better() -> None:
    rng = np.random.default_rng(0)
    windows = []
    for _ in range(60):
        features = rng.random((12, len(NAMES) + len(ALGORITHMS))).astype(np.float32)
        level = rng.uniform(0.2, 0.5)
        ap_70 = (level + 0.4 * features[:, 3]).astype(np.float32)
        windows.append(Samples(features, ap_70, np.full((12, 2), np.nan)))
    network = training.learn(windows[10:], steps=400)
    model = training.as_surrogate(network, ALGORITHMS, {})
    hits = [np.corrcoef(model.predict(one.features), one.ap_70)[0, 1] for one in windows[:10]]
    assert min(hits) > 0.8
    again = training.learn(windows[10:], steps=400)
    same = training.as_surrogate(again, ALGORITHMS, {})
    assert (same.predict(windows[0].features) == model.predict(windows[0].features)).all()


def test_measured_windows_are_kept_and_trained_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(training, "STEPS", 20)
    monkeypatch.setattr(measuring, "CHOICES", 8)
    monkeypatch.setattr(Window, "_measure", _pretended)
    kept = ResultStore(tmp_path / "kept", measuring.SAMPLES_FROM)
    held_out = training_windows(3)[:1]
    others = [one for own in other_settings(held_out).values() for one in own]
    for scenario in (*training_windows(3), *others):
        kept.put(measuring.key_of(scenario), measuring.measure(scenario))
    output = tmp_path / "model.safetensors"
    errors = training.train(3, 1, tmp_path, output)
    names = ["as learnt", "16 rings", "pose noise 0.4 m", "2 times the floor"]
    assert [one.setting for one in errors] == names
    told = json.loads((tmp_path / "surrogate.json").read_text())
    assert [row["setting"] for row in told["rows"]] == names
    assert all(row["windows"] == 1 and row["mae_within"] >= 0 for row in told["rows"])
    assert told["rows"][0]["noise"] is None, "there are no halves"
    assert read_surrogate(output).algorithms == ALGORITHMS
    said = capsys.readouterr().err
    assert "measured 1/" not in said, "what was kept was measured again"
    assert "2 windows to learn from" in said


def test_the_quality_model_is_the_line_that_was_measured() -> None:
    rng = np.random.default_rng(3)
    windows = []
    for _ in range(40):
        own = np.full(6, rng.uniform(0.2, 0.6))
        shown = np.where(np.arange(6) > 0, rng.uniform(own, 1.0), own)
        names = ("", "early", "late", "early", "late", "early")
        gain = np.array([{"": 0.0, "early": 0.5, "late": 0.3}[name] for name in names])
        ap_70 = 0.3 + 0.4 * own + gain * (shown - own)
        windows.append(Shares(names, np.column_stack([own, shown]), ap_70, np.zeros((6, 2))))
    model = fitted(windows, ["early", "late"], (25.0, 25.0))
    assert model.calibrated
    assert (model.base, model.own, model.enough) == (0.3, 0.4, 1.0)
    assert model.gains == {"early": 0.5, "late": 0.3}


def test_errors_stand_beside_those_of_what_they_are_measured_by() -> None:
    halves = [np.array([[0.6, 0.4], [0.6, 0.8]]), np.full((2, 2), np.nan)]
    found = errors_of("here", [np.array([0.2, 0.2]), np.array([0.1, -0.1])], halves)
    assert found.windows == 2
    assert found.mae == pytest.approx((0.2 + 0.1) / 2)
    assert found.mae_within == pytest.approx((0.0 + 0.1) / 2)
    assert found.noise == pytest.approx(0.1), "half of the difference of the halves"
    assert found.noise_within == pytest.approx(0.1)


def test_other_settings_change_one_thing_each_to_what_is_not_learnt_from() -> None:
    windows = training_windows(24)
    others = other_settings(windows)
    assert len({one.setting() for own in (windows, *others.values()) for one in own}) == 4 * 24
    learnt = {(one.rings, one.room, one.pose_noise_m) for one in windows}
    for own in others.values():
        assert not learnt & {(one.rings, one.room, one.pose_noise_m) for one in own}
        assert [one.seed for one in own] == [one.seed for one in windows]
    roomy, usual = (own[11].open() for own in (others["2 times the floor"], windows))
    assert isinstance(roomy, FactoryWorld)
    assert isinstance(usual, FactoryWorld)
    assert len(roomy.floor.blocks) >= 1.7 * len(usual.floor.blocks)
    few, many = (len(w[0].open().scan("R1", 0).points) for w in (others["16 rings"], windows))
    assert few < 0.6 * many


def _pretended(window: Window, choice: Choice) -> Outcome:
    share = len(choice.participants) / 10
    return Outcome(share, share, share, 100.0, 4, 10, None)


def test_an_output_that_cannot_be_written_is_said_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for output in (tmp_path, tmp_path / "missing" / "model.safetensors"):
        assert main(["eval", "train-surrogate", "--output", str(output)]) == 1
        assert f"{output} cannot be written" in capsys.readouterr().err
