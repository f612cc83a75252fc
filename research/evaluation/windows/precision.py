"""Average precision of frames that count more or less than once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from perception.metrics import Match

K = TypeVar("K")


def shares(members: Sequence[K]) -> dict[K, float]:
    """The share of each member of a sequence that is not empty, in the order in which they come."""
    return {member: times / len(members) for member, times in Counter(members).items()}


def precision_of(matches: Sequence[tuple[Match, float]]) -> float:
    """AP as `perception.metrics.precision_of` counts it, of frames with these weights."""
    total = sum(weight * one.truths for one, weight in matches)
    hits = np.concatenate([np.zeros(0, np.bool_), *(one.hits for one, _ in matches)])
    if not total or not len(hits):
        return 0.0
    order = np.argsort(-np.concatenate([one.scores for one, _ in matches]), kind="stable")
    weights = np.repeat(
        [float(weight) for _, weight in matches], [len(one.hits) for one, _ in matches]
    )[order]
    true_positives = np.cumsum(weights * hits[order])
    recall = true_positives / total
    precision = true_positives / np.cumsum(weights)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * envelope))
