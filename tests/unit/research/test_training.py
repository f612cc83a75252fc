"""Training runs: small ones, to the end, interrupted, resumed and refused."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import research.training.codes
import research.training.run
import worlds.factory
import worlds.road
from perception.detector.codebook import ENTRIES, PARTS
from perception.detector.grid import bev_config
from perception.detector.learned import Detector
from perception.detector.network import FEATURES
from research.training.learn import rate_at
from research.training.plans import TEST_SEEDS, Plan, plan
from research.training.run import Run
from research.training.samples import ActorWorld
from research.training.stream import Batch, batches, make_batch
from swarm.errors import PerceptionError
from tests.support.tiny_detector import TINY, random_codebook, tiny  # noqa: F401
from worlds.factory.world import FactoryWorld
from worlds.road.world import RoadWorld

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("tiny", "quick")]
STEPS = 4
SMALL = FactoryWorld(robots=3, seed=5000)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """No codebook, and a line of the curve for every step."""
    monkeypatch.setattr(
        research.training.run, "codebook_of", lambda plan, tensors: random_codebook()
    )
    monkeypatch.setattr(research.training.run, "SHOW_EVERY", 1)


def small(steps: int = STEPS, **changes: Any) -> Plan:
    """The factory's plan with few steps, on the small grid and always the same floor."""
    changes = {"config": TINY.name, "batch": 1, "world": lambda rng: SMALL, **changes}
    return replace(plan("factory"), steps=steps, **changes)


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[Batch]:
    """The batches that runs are shown."""
    seen: list[Batch] = []
    losses = research.training.run.losses  # type: ignore[attr-defined]

    def spy(network: Any, config: Any, batch: Batch, seed: int) -> dict[str, torch.Tensor]:
        seen.append(batch)
        return losses(network, config, batch, seed)

    monkeypatch.setattr(research.training.run, "losses", spy)
    return seen


@pytest.fixture
def stop_in(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Has the process asked to stop while it makes the batch of a step."""

    def arrange(step: int) -> None:
        def interrupting(plan: Plan, begin: int, workers: int) -> Any:
            for batch in batches(plan, begin, workers):
                if batch.step == step:
                    os.kill(os.getpid(), signal.SIGTERM)
                yield batch

        monkeypatch.setattr(research.training.run, "batches", interrupting)

    return arrange


def same(a: Batch, b: Batch) -> bool:
    tensors = [
        *zip(a.clouds, b.clouds, strict=True),
        (a.fused.heat, b.fused.heat),
        (a.fused.counted, b.fused.counted),
        (a.fused.boxes, b.fused.boxes),
        (a.views.heat, b.views.heat),
        (a.views.boxes, b.views.boxes),
    ]
    same_shape = (a.step, a.counts) == (b.step, b.counts)
    return same_shape and all(torch.equal(one, other) for one, other in tensors)


def curve(folder: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (folder / "curve.jsonl").read_text().splitlines()]


def test_a_run_ends_with_weights_a_curve_and_its_progress(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Run(small(), tmp_path)
    assert run.train(workers=0)
    assert run.step == STEPS
    lines = curve(tmp_path)
    assert [line["step"] for line in lines] == [1, 2, 3, 4]
    assert all(np.isfinite(list(line.values())).all() for line in lines)
    assert {"heat", "boxes", "iou", "view", "total"} < lines[0].keys()
    assert f"step {STEPS}/{STEPS}" in capsys.readouterr().err
    detector = Detector(TINY.name, run.weights)
    found = detector.detect(SMALL.scan("R1", 0).points)
    assert np.isfinite(found.centers).all()


def test_training_lowers_the_loss(tmp_path: Path) -> None:
    # The same sample again and again can be learnt by heart.
    one = np.random.default_rng(0).bit_generator.state

    def same_draw(rng: np.random.Generator) -> FactoryWorld:
        rng.bit_generator.state = one
        return SMALL

    Run(small(25, world=same_draw), tmp_path).train(workers=0)
    totals = [line["total"] for line in curve(tmp_path)]
    assert np.mean(totals[-3:]) < 0.7 * np.mean(totals[:3])


def test_a_run_that_was_interrupted_goes_on_where_it_was(
    tmp_path: Path, shown: list[Batch], stop_in: Callable[[int], None]
) -> None:
    whole = Run(small(), tmp_path / "whole")
    assert whole.train(workers=0)
    expected = list(shown)
    shown.clear()

    stop_in(1)
    handler = signal.getsignal(signal.SIGTERM)
    first = Run(small(), tmp_path / "parts")
    assert not first.train(workers=0)
    assert first.step == 2
    assert not first.weights.exists()
    assert signal.getsignal(signal.SIGTERM) == handler
    assert [batch.step for batch in shown] == [0, 1]

    stop_in(-1)
    second = Run(small(), tmp_path / "parts")
    assert second.step == 2
    assert second.train(workers=0)
    assert [batch.step for batch in shown] == [0, 1, 2, 3]
    assert all(same(a, b) for a, b in zip(shown, expected, strict=True))
    # Not by which one is the faster just now: each rounds in its own way.
    reached, uninterrupted = (Detector(TINY.name, run.weights, "torch") for run in (second, whole))
    cloud = SMALL.scan("R2", 7).points
    assert torch.allclose(reached.encode(cloud), uninterrupted.encode(cloud), atol=1e-5)


def test_the_curve_of_an_interrupted_run_is_whole(
    tmp_path: Path, stop_in: Callable[[int], None]
) -> None:
    stop_in(1)
    Run(small(), tmp_path).train(workers=0)
    stop_in(-1)
    Run(small(), tmp_path).train(workers=0)
    assert [line["step"] for line in curve(tmp_path)] == [1, 2, 3, 4]


def test_what_was_measured_after_the_last_state_is_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shown: list[Batch]
) -> None:
    # A machine that loses its power: the state is of step 2, the curve reaches further.
    monkeypatch.setattr(research.training.run, "SAVE_EVERY", 2)
    losses = research.training.run.losses  # type: ignore[attr-defined]

    def fail_late(network: Any, config: Any, batch: Batch, seed: int) -> dict[str, torch.Tensor]:
        if batch.step == 3:
            raise SystemExit("no power")
        return losses(network, config, batch, seed)

    monkeypatch.setattr(research.training.run, "losses", fail_late)
    with pytest.raises(SystemExit):
        Run(small(), tmp_path).train(workers=0)
    assert [line["step"] for line in curve(tmp_path)] == [1, 2, 3]
    monkeypatch.setattr(research.training.run, "losses", losses)
    shown.clear()
    run = Run(small(), tmp_path)
    assert run.step == 2
    assert run.train(workers=0)
    assert [batch.step for batch in shown] == [2, 3]
    assert [line["step"] for line in curve(tmp_path)] == [1, 2, 3, 4]


def test_a_finished_run_trains_nothing_more(tmp_path: Path, shown: list[Batch]) -> None:
    Run(small(2), tmp_path).train(workers=0)
    shown.clear()
    again = Run(small(2), tmp_path)
    assert again.train(workers=0)
    assert shown == []


@pytest.mark.parametrize(
    "change", [{"steps": 5}, {"batch": 2}, {"rate": 1e-4}, {"seed": 2}, {"config": "factory"}]
)
def test_the_state_of_another_plan_is_refused(
    change: dict[str, Any], tmp_path: Path, stop_in: Callable[[int], None]
) -> None:
    stop_in(0)
    Run(small(), tmp_path).train(workers=0)
    with pytest.raises(PerceptionError, match=r"state\.safetensors is a run of .* remove it"):
        Run(small(**change), tmp_path)


@pytest.mark.parametrize("content", [b"", b"no state", bytes(100)])
def test_a_state_that_cannot_be_read_is_refused_by_name(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "state.safetensors").write_bytes(content)
    with pytest.raises(PerceptionError, match=r"state\.safetensors is not the state of a training"):
        Run(small(), tmp_path)


def test_weights_are_no_state(tmp_path: Path) -> None:
    run = Run(small(1), tmp_path)
    run.train(workers=0)
    os.replace(run.weights, tmp_path / "state.safetensors")
    with pytest.raises(PerceptionError, match="is not the state of a training run"):
        Run(small(1), tmp_path)


def test_a_loss_that_is_no_number_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    losses = research.training.run.losses  # type: ignore[attr-defined]

    def broken(network: Any, config: Any, batch: Batch, seed: int) -> dict[str, torch.Tensor]:
        parts = losses(network, config, batch, seed)
        return {**parts, "total": parts["total"] * (float("nan") if batch.step == 1 else 1.0)}

    monkeypatch.setattr(research.training.run, "losses", broken)
    run = Run(small(), tmp_path)
    with pytest.raises(PerceptionError, match="loss of step 1 is not finite"):
        run.train(workers=0)
    assert not run.weights.exists()


def test_a_batch_follows_from_seed_and_step_alone() -> None:
    first = make_batch(small(batch=2), 3)
    assert len(first.counts) == 2
    assert sum(first.counts) == len(first.clouds)
    assert first.fused.heat.shape[0] == 2
    assert first.views.heat.shape[0] == len(first.clouds)
    assert same(first, make_batch(small(batch=2), 3))
    assert not np.array_equal(first.clouds[0], make_batch(small(batch=2), 4).clouds[0])
    other = make_batch(small(batch=2, seed=9), 3)
    assert not np.array_equal(first.clouds[0], other.clouds[0])


def test_worker_processes_make_the_same_batches_in_order() -> None:
    alone = list(batches(small(5), 1, 0))
    shared = list(batches(small(5), 1, 2))
    assert [batch.step for batch in shared] == [1, 2, 3, 4]
    assert all(same(a, b) for a, b in zip(shared, alone, strict=True))


def test_the_learning_rate_rises_and_falls() -> None:
    long = small(1000)
    rates = [rate_at(long, step) for step in range(1000)]
    assert 0 < rates[0] < rates[25] < rates[50]
    assert max(rates) == pytest.approx(long.rate)
    assert np.argmax(rates) in (49, 50)
    assert (np.diff(rates[51:]) < 0).all()
    assert rates[-1] == pytest.approx(0.01 * long.rate, rel=0.05)


@pytest.mark.parametrize("steps", [1, 2, 4, 19, 30])
def test_short_runs_stay_below_the_highest_rate_too(steps: int) -> None:
    short = small(steps)
    assert all(0 < rate_at(short, step) <= short.rate for step in range(steps))


def test_worlds_for_tests_are_never_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[dict[str, Any]] = []

    class Spy(FactoryWorld):
        def __init__(self, **settings: Any) -> None:
            drawn.append(settings)

    monkeypatch.setattr(worlds.factory.world, "FactoryWorld", Spy)
    real = plan("factory")
    for step in range(200):
        real.world(np.random.default_rng([real.seed, step, 0]))
    seeds = [settings["seed"] for settings in drawn]
    assert len(set(seeds)) > 190
    assert max(seeds) < TEST_SEEDS.start
    assert min(seeds) >= 1000
    assert {settings["rings"] for settings in drawn} == {16, 32, 64}
    assert len({settings["scenario"] for settings in drawn}) > 2
    assert min(settings["robots"] for settings in drawn) >= 2


def test_streets_for_tests_are_never_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[dict[str, Any]] = []

    class Spy(RoadWorld):
        def __init__(self, **settings: Any) -> None:
            drawn.append(settings)

    monkeypatch.setattr(worlds.road.world, "RoadWorld", Spy)
    real = plan("road")
    for step in range(200):
        real.world(np.random.default_rng([real.seed, step, 0]))
    assert len({settings["seed"] for settings in drawn}) > 190
    assert min(settings["seed"] for settings in drawn) >= 1000
    assert max(settings["seed"] for settings in drawn) < TEST_SEEDS.start
    assert {settings["robots"] for settings in drawn} == {1, 2, 3}


def test_a_batch_of_streets_has_its_vehicles() -> None:
    road = replace(plan("road"), batch=1)
    batch = make_batch(road, 0)
    rows, columns = bev_config("road").cells
    assert road.shown().cells == (rows, columns // 2)
    assert batch.fused.heat.shape == (1, 1, *road.shown().cells)
    assert len(batch.fused.map) > 0
    assert all(len(cloud) > 20_000 for cloud in batch.clouds)


def test_samples_of_one_street_differ() -> None:
    made: list[RoadWorld] = []
    road = plan("road")

    def noted(rng: np.random.Generator) -> ActorWorld:
        made.append(RoadWorld(robots=2, seed=int(rng.integers(1000, 2000))))
        return made[-1]

    batch = make_batch(replace(road, world=noted, batch=4), 0)
    assert len(made) == 2
    assert len({len(cloud) for cloud in batch.clouds}) > 2


def test_an_unknown_plan_is_refused_with_those_there_are() -> None:
    with pytest.raises(PerceptionError, match="'sea'; allowed: factory, road"):
        plan("sea")


def test_a_codebook_is_learnt_of_what_the_network_sends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(research.training.codes, "BATCHES", 2)
    monkeypatch.setattr(research.training.codes, "MIN_CHANCE", 0.0)
    monkeypatch.setattr(research.training.run, "codebook_of", research.training.codes.codebook_of)
    run = Run(small(2), tmp_path)
    run.train(workers=0)
    book = Detector(TINY.name, run.weights).codebook
    assert book.shape == (PARTS, ENTRIES, FEATURES // PARTS)
    assert book.dtype == np.float32
    assert book.min() >= 0.0
    assert book.max() <= 1.0
    assert book.std() > 0.0
