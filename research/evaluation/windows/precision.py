"""Average precision of frames that count more or less than once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TypeVar

from perception import metrics
from perception.metrics import Match

K = TypeVar("K")


def shares(members: Sequence[K]) -> dict[K, float]:
    """The share of each member of a sequence that is not empty, in the order in which they come."""
    return {member: times / len(members) for member, times in Counter(members).items()}


def precision_of(matches: Sequence[tuple[Match, float]]) -> float:
    """AP as `perception.metrics.precision_of` counts it, of frames with these weights."""
    return metrics.precision_of(
        [one for one, _ in matches], weights=[weight for _, weight in matches]
    )
