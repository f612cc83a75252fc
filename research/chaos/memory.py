"""How memory grows, with what that is worth."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import msgspec
import numpy as np

from research.chaos.history import Memory

MIN_SAMPLES = 8
WARM_UP_S = 20.0
"""Caches and thread stacks fill first."""


class Slope(msgspec.Struct, frozen=True, kw_only=True):
    """Growth of one process: megabytes an hour, and the standard error of that."""

    service: str
    pid: int
    mb_per_h: float
    error_mb_per_h: float
    seconds: float


def slopes(samples: Iterable[Memory]) -> tuple[Slope, ...]:
    """Of every process that was seen often enough, the steepest first."""
    by_process: dict[tuple[str, int], list[Memory]] = defaultdict(list)
    for sample in samples:
        by_process[sample.service, sample.pid].append(sample)
    found = []
    for (service, pid), seen in by_process.items():
        late = [s for s in seen if s.at_s >= seen[0].at_s + WARM_UP_S]
        if len(late) < MIN_SAMPLES:
            continue
        hours = np.array([s.at_s for s in late]) / 3600.0
        megabytes = np.array([s.rss_bytes for s in late]) / 1e6
        (slope, _), covariance = np.polyfit(hours, megabytes, 1, cov="unscaled")
        rest = megabytes - np.polyval(np.polyfit(hours, megabytes, 1), hours)
        spread = float(rest @ rest) / (len(late) - 2)
        found.append(
            Slope(
                service=service,
                pid=pid,
                mb_per_h=round(float(slope), 2),
                error_mb_per_h=round(float(np.sqrt(spread * covariance[0, 0])), 2),
                seconds=round(late[-1].at_s - late[0].at_s, 1),
            )
        )
    return tuple(sorted(found, key=lambda one: -one.mb_per_h))
