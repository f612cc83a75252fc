"""A link whose rate changes, as a queue: what is sent first is through first."""

from __future__ import annotations

import math
from collections.abc import Callable

Rate = Callable[[float], float]
"""bit/s at a time in seconds."""
STEP_S = 0.1
"""A rate holds so long, from a multiple of it on."""
GIVEN_UP_S = 10.0
"""Nobody waits so long for an answer."""


class Cell:
    """Carries payloads one after the other, whole."""

    def __init__(self, rate_bps: Rate) -> None:
        self._rate_bps = rate_bps
        self._free_at_s = 0.0

    def send(self, at_s: float, size_bytes: int) -> float:
        """When a payload that is there at a time is through; infinite where that takes longer than
        GIVEN_UP_S. Call it in the order of the times."""
        begun_s = max(at_s, self._free_at_s)
        self._free_at_s = _through_s(self._rate_bps, begun_s, 8.0 * size_bytes)
        return self._free_at_s if self._free_at_s <= at_s + GIVEN_UP_S else math.inf


def _through_s(rate_bps: Rate, begun_s: float, bits: float) -> float:
    now_s, step = begun_s, math.floor(begun_s / STEP_S + 1e-9)
    while now_s < begun_s + GIVEN_UP_S:
        bps = rate_bps(step * STEP_S)
        end_s = (step + 1) * STEP_S
        if bits <= bps * (end_s - now_s):
            return now_s + bits / bps
        bits -= bps * (end_s - now_s)
        now_s, step = end_s, step + 1
    # What is left keeps the link busy at the last rate.
    return now_s + bits / bps
