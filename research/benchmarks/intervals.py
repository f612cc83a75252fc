"""How sure figures of few samples are: 95 % intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import beta

from research.evaluation.bootstrap import COVERAGE, RESAMPLES


def share_interval(number: int, of: int) -> tuple[float, float]:
    """Where the share lies of which `number` of `of` independent trials are a sample (Clopper and
    Pearson, 1934)."""
    rest = (1.0 - COVERAGE) / 2.0
    low = float(beta.ppf(rest, number, of - number + 1)) if number else 0.0
    high = float(beta.ppf(1.0 - rest, number + 1, of - number)) if number < of else 1.0
    return round(low, 4), round(high, 4)


def ratio_of_medians(
    ours: Sequence[float], theirs: Sequence[float]
) -> tuple[float, tuple[float, float]]:
    """Median of ours over median of theirs, measured in turn on the same inputs, and its percentile
    bootstrap interval (Efron, 1979): pairs are drawn, so that what slowed both falls on both."""
    pairs = np.array([ours, theirs], dtype=np.float64)
    drawn = np.random.default_rng(0).integers(0, pairs.shape[1], (RESAMPLES, pairs.shape[1]))
    medians = np.median(pairs[:, drawn], axis=2)
    rest = 50.0 * (1.0 - COVERAGE)
    low, high = np.percentile(medians[0] / medians[1], (rest, 100.0 - rest))
    ratio = np.median(pairs[0]) / np.median(pairs[1])
    return round(float(ratio), 4), (round(float(low), 4), round(float(high), 4))
