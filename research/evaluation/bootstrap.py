"""Means of paired differences with their uncertainty."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

RESAMPLES = 2000
COVERAGE = 0.95


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean and the percentile interval of COVERAGE around it."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:+.3f} [{self.low:+.3f}, {self.high:+.3f}]"


def bootstrap_mean(
    values: Sequence[float], groups: Sequence[Hashable] = (), seed: int = 0
) -> Interval:
    """The mean of the values and its percentile bootstrap interval (Efron, 1979): they are drawn
    again with replacement, RESAMPLES times. NaN of no values.

    groups: of each value, what it shares with others (a floor, a recording): groups are drawn
        whole then, since values of one are not independent (Davison and Hinkley, 1997, 3.8).
    """
    sample = np.asarray(values, dtype=np.float64)
    if not len(sample):
        return Interval(float("nan"), float("nan"), float("nan"))
    names = list(groups) or list(range(len(sample)))
    number_of = {name: number for number, name in enumerate(dict.fromkeys(names))}
    group = [number_of[name] for name in names]
    sums, counts = np.bincount(group, sample), np.bincount(group)
    drawn = np.random.default_rng(seed).integers(0, len(sums), (RESAMPLES, len(sums)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return Interval(float(sample.mean()), float(low), float(high))
