"""Trains the surrogate: measures, learns, reports the error on windows that were held out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from ego_agent.plan.surrogate.features import NAMES
from ego_agent.plan.surrogate.model import Surrogate, write_surrogate
from perception.fusion.registry import fusion_names
from research.evaluation.surrogate.errors import Errors, errors_of, table, write_errors
from research.evaluation.surrogate.measuring import measured_windows
from research.evaluation.surrogate.samples import (
    HELD_OUT,
    Samples,
    other_settings,
    samples,
    training_windows,
)
from research.evaluation.windows.scenarios import Scenario
from swarm.errors import EvaluationError

HIDDEN = (48, 24)
STEPS = 4000
BATCH = 48
"""Windows a step."""
RATE, DECAY = 3e-3, 1e-3
DIFFERENCES = 4.0
"""Weight of differences within a window: a decision needs those more than the level."""
SHAKEN = 0.02
"""Standard deviation of noise on the features while training."""
SEED = 7
AS_LEARNT = "as learnt"
"""The setting of the generator that training windows have."""
ERRORS = "surrogate.json"


def train(windows: int, workers: int, folder: Path, output: Path) -> list[Errors]:
    """Writes the surrogate to `output`, and ERRORS to `folder`, where what was measured is kept.

    Returns the errors on windows that were held out, as they are and from other settings of the
    generator. Raises EvaluationError for an output that cannot be written, before anything is
    measured, and for too few windows.
    """
    if output.is_dir() or not output.parent.is_dir():
        raise EvaluationError(f"{output} cannot be written: name a file in a folder that exists")
    algorithms = fusion_names("factory")
    scenarios = training_windows(windows)
    held_out = scenarios[::HELD_OUT]
    tests = {AS_LEARNT: held_out, **other_settings(held_out)}
    learning = _measured([s for s in scenarios if s not in held_out], workers, folder, algorithms)
    measured = {name: _measured(own, workers, folder, algorithms) for name, own in tests.items()}
    if not learning or not all(measured.values()):
        raise EvaluationError(f"{windows} windows are too few to learn from")
    facts = {"windows": str(len(learning)), "steps": str(STEPS), "seed": str(SEED)}
    model = as_surrogate(learn(learning, STEPS), algorithms, facts)
    write_surrogate(output, model)
    errors = [
        errors_of(
            name,
            [model.predict(one.features) - one.ap_70.astype(np.float64) for one in own],
            [one.halves for one in own],
        )
        for name, own in measured.items()
    ]
    write_errors(folder / ERRORS, errors)
    print(
        f"wrote {output} and {folder / ERRORS}: {len(learning)} windows to learn from; of AP@0.7 "
        f"on others:\n{table(errors)}",
        file=sys.stderr,
    )
    return errors


def as_surrogate(
    network: nn.Sequential, algorithms: Sequence[str], facts: dict[str, str]
) -> Surrogate:
    """A trained network in the form that an ego reads."""
    layers = [layer for layer in network if isinstance(layer, nn.Linear)]
    return Surrogate(
        tuple(algorithms),
        tuple(layer.weight.detach().numpy() for layer in layers),
        tuple(layer.bias.detach().numpy() for layer in layers),
        facts,
    )


def _measured(
    scenarios: Sequence[Scenario], workers: int, folder: Path, algorithms: Sequence[str]
) -> list[Samples]:
    """Samples of the windows that hold a true box."""
    values = measured_windows(scenarios, workers, folder)
    found = [samples(one, algorithms) for one in values]
    return [one for one in found if one is not None]


def learn(windows: Sequence[Samples], steps: int) -> nn.Sequential:
    """A network that has learnt from the windows; equal windows give equal networks."""
    torch.manual_seed(SEED)
    rng = np.random.default_rng(SEED)
    inputs = windows[0].features.shape[1]
    network = nn.Sequential(
        nn.Linear(inputs, HIDDEN[0]),
        nn.ReLU(),
        nn.Linear(HIDDEN[0], HIDDEN[1]),
        nn.ReLU(),
        nn.Linear(HIDDEN[1], 1),
    )
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, steps)
    for _ in range(steps):
        picked = [windows[i] for i in rng.integers(0, len(windows), BATCH)]
        features, target, window = _batch(picked)
        noise = torch.from_numpy(rng.normal(0, SHAKEN, features.shape).astype(np.float32))
        noise[:, len(NAMES) :] = 0.0
        error = torch.sigmoid(network(features + noise)[:, 0]) - target
        level = torch.zeros(len(picked)).index_add(0, window, error) / torch.bincount(window)
        within = error - level[window]
        loss = error.square().mean() + DIFFERENCES * within.square().mean()
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
    return network.eval()


def _batch(picked: Sequence[Samples]) -> tuple[Tensor, Tensor, Tensor]:
    """Features (n, f), AP@0.7 (n,), and the number of each row's window (n,)."""
    features = np.concatenate([one.features for one in picked])
    target = np.concatenate([one.ap_70 for one in picked])
    window = np.repeat(np.arange(len(picked)), [len(one.ap_70) for one in picked])
    return torch.from_numpy(features), torch.from_numpy(target), torch.from_numpy(window)
