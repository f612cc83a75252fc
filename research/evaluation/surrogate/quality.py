"""Fits the quality model of a detector to what choices brought: Q as a precision.

A straight line in what the ego sees alone and in what participants add to that, up to where more
brings nothing, by least squares over all choices: `ego_agent/knowledge/quality.py` has its meaning.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.quality import QualityModel, read_quality
from ego_agent.plan.choices.scoring import Scorer
from perception.fusion.registry import fusion_names
from research.evaluation.surrogate.errors import errors_of, table
from research.evaluation.surrogate.measuring import measured_windows
from research.evaluation.surrogate.samples import HELD_OUT, scene_of, training_windows
from research.evaluation.windows import announcements
from research.evaluation.windows.choice import Choice
from research.evaluation.windows.measure import unpacked
from swarm.errors import EvaluationError
from swarm.files import write_whole
from worlds.cooperative.judging import EVALUATION_RANGES_M

ENOUGH = (1.0, 0.95, 0.9, 0.85, 0.8)
"""That are tried."""
DIGITS = 3
FOLDS = 5
ROUNDING = 6
"""Digits of squares: a smaller difference decides nothing."""


@dataclass(frozen=True)
class Shares:
    """Choices in one window."""

    algorithms: tuple[str, ...]
    """Empty for the ego alone."""
    shown: NDArray[np.float64]
    """(n, 2): the share that the ego sees, and that all who take part see."""
    ap_70: NDArray[np.float64]
    """(n,)."""
    halves: NDArray[np.float64]
    """(n, 2): AP@0.7 of either half of the frames; NaN where one holds no true box."""


def fit_quality(
    detector: str, windows: int, workers: int, folder: Path, output: Path
) -> QualityModel:
    """Measures choices, fits the detector's model and puts it into `output` beside the others.

    Says on standard error how far it is off on windows that were held out. Raises EvaluationError
    for an output that cannot be written and for too few windows, DecisionError for one that holds
    something else.
    """
    if output.is_dir() or not output.parent.is_dir():
        raise EvaluationError(f"{output} cannot be written: name a file in a folder that exists")
    models = dict(read_quality(output)) if output.exists() else {}
    half_m = EVALUATION_RANGES_M[detector]
    measured = measured_windows(training_windows(windows, detector), workers, folder)
    found = [shares(values, detector, half_m) for values in measured]
    known = [one for one in found if one is not None]
    test = known[::HELD_OUT]
    learning = [one for at, one in enumerate(known) if at % HELD_OUT]
    if not test or not learning:
        raise EvaluationError(f"{len(known)} windows are too few to fit")
    algorithms = fusion_names(detector)
    model = fitted(learning, algorithms, half_m)
    off, halves = [_off(model, one) for one in test], [one.halves for one in test]
    errors = errors_of(detector, off, halves)
    models[detector] = fitted(known, algorithms, half_m)
    write_whole(output, msgspec.json.format(msgspec.json.encode(models), indent=1).decode() + "\n")
    print(
        f"wrote {output}: {detector} from {len(known)} windows; without those that it was judged "
        f"by, of AP@0.7:\n{table([errors])}",
        file=sys.stderr,
    )
    return models[detector]


def shares(values: Sequence[Any], detector: str, half_m: tuple[float, float]) -> Shares | None:
    """What `measuring.measure` returned, by shares; None without a true box."""
    ego, messages, measured = values
    outcomes = unpacked(measured)
    if not next(iter(outcomes.values())).ground_truth:
        return None
    scene = scene_of(ego, announcements.unpacked(messages), detector)
    scorer = Scorer(scene, Knowledge(quality=QualityModel(half_m=half_m)))
    return Shares(
        tuple(choice.algorithm for choice in outcomes),
        np.array([[scorer.own_share, _share(scorer, choice)] for choice in outcomes]),
        np.array([one.ap_70 for one in outcomes.values()]),
        np.array([one.halves or (np.nan, np.nan) for one in outcomes.values()]),
    )


def _share(scorer: Scorer, choice: Choice) -> float:
    return scorer.share([0, *sorted(scorer.row_of[robot] for robot in choice.participants)])


def fitted(
    windows: Sequence[Shares], algorithms: Sequence[str], half_m: tuple[float, float]
) -> QualityModel:
    """The model with the least squares of errors over all choices; `enough` is the one with the
    least where a fifth of the windows in turn is judged by a line through the others."""
    enough = min(ENOUGH, key=lambda share: round(_crossed(windows, algorithms, share), ROUNDING))
    inputs, target = _equations(windows, algorithms, enough)
    base, own, *gains = _solved(inputs, target).round(DIGITS).tolist()
    named: Mapping[str, float] = dict(zip(algorithms, gains, strict=True))
    return QualityModel(
        base=base, own=own, gains=named, enough=enough, half_m=half_m, calibrated=True
    )


def _crossed(windows: Sequence[Shares], algorithms: Sequence[str], enough: float) -> float:
    """Mean square of the errors in windows that the line was not fitted to."""
    squares: list[float] = []
    for part in range(min(FOLDS, len(windows))):
        others = [one for at, one in enumerate(windows) if at % FOLDS != part]
        if others:
            solved = _solved(*_equations(others, algorithms, enough))
            inputs, target = _equations(windows[part::FOLDS], algorithms, enough)
            squares += ((inputs @ solved - target) ** 2).tolist()
    return float(np.mean(squares)) if squares else 0.0


def _solved(inputs: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.clip(np.linalg.lstsq(inputs, target, rcond=None)[0], 0.0, 1.0)


def _equations(
    windows: Sequence[Shares], algorithms: Sequence[str], enough: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    inputs = np.concatenate([_inputs(one, algorithms, enough) for one in windows])
    return inputs, np.concatenate([one.ap_70 for one in windows])


def _inputs(one: Shares, algorithms: Sequence[str], enough: float) -> NDArray[np.float64]:
    own, shown = np.minimum(one.shown, enough).T
    used = np.array([[name == at for at in algorithms] for name in one.algorithms])
    return np.column_stack([np.ones(len(own)), own, used * (shown - own)[:, None]])


def _off(model: QualityModel, one: Shares) -> NDArray[np.float64]:
    predicted = [
        model.quality(name, own, shown)
        for name, (own, shown) in zip(one.algorithms, one.shown.tolist(), strict=True)
    ]
    return np.array(predicted) - one.ap_70
