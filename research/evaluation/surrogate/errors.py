"""How far predictions are off, beside how far off what they are judged by is itself."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from research.evaluation.machine import machine_facts
from research.evaluation.tables import markdown
from swarm.files import write_whole

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Errors:
    """Mean absolute errors of AP@0.7 over the windows of one setting of the generator."""

    setting: str
    windows: int
    mae: float
    mae_within: float
    """Of differences from the mean of the window, which are what a decision needs."""
    noise: float
    """By how much the measured AP@0.7 is itself off: half of what its two halves of the frames
    differ, since the mean of two halves is off by as much. NaN where no window has halves."""
    noise_within: float
    """The same of differences from the mean of the window."""


def errors_of(setting: str, off: Sequence[Floats], halves: Sequence[Floats]) -> Errors:
    """The errors in windows, of which there must be one at least: by how much each choice's
    prediction is off, (n,), and AP@0.7 on either half of the frames, (n, 2), NaN where a half holds
    no true box."""
    apart = [(one[:, 0] - one[:, 1]) / 2 for one in halves if np.isfinite(one).all()]
    return Errors(setting, len(off), _mean(off), _within(off), _mean(apart), _within(apart))


def _mean(windows: Sequence[Floats]) -> float:
    return float(np.mean([np.abs(one).mean() for one in windows])) if windows else math.nan


def _within(windows: Sequence[Floats]) -> float:
    return _mean([one - one.mean() for one in windows])


def _plain(value: object) -> object:
    return None if isinstance(value, float) and math.isnan(value) else value


def table(rows: Sequence[Errors]) -> str:
    """A line a setting, as Markdown."""
    return markdown(
        ("setting", "windows", "off by", "in differences", "measured off by", "in differences"),
        [
            (
                one.setting, one.windows, f"{one.mae:.3f}", f"{one.mae_within:.3f}",
                f"{one.noise:.3f}", f"{one.noise_within:.3f}",
            )
            for one in rows
        ],
    )  # fmt: skip


def write_errors(path: Path, rows: Sequence[Errors]) -> None:
    """The rows as JSON with the machine's facts; None for what could not be told."""
    plain = [{name: _plain(value) for name, value in asdict(one).items()} for one in rows]
    write_whole(path, json.dumps({"rows": plain, "machine": machine_facts()}, indent=1) + "\n")
