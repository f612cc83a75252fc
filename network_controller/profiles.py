"""What a capacity is at each moment: fixed, by shift of the day, or as recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

SHIFT_BPS = ((6.0, 55e6), (12.0, 20e6), (18.0, 5e6))
"""Hour of the day and capacity from then on: CoAdapt's tiers by shift. Before 6 h it is night."""
SHIFT_START_H = 6.0
SINE_SHARE = 0.15
SINE_PERIOD_S = 50.0
"""CoAdapt's ripple on each tier: 15 % of it, one wave in 50 steps."""
SHIFT_STEP_S = 1.0


class Profile(Protocol):
    """A capacity as a function of time."""

    def rate_bps(self, elapsed_s: float) -> float:
        """The capacity `elapsed_s` after the profile began."""
        ...

    def next_change_s(self, elapsed_s: float) -> float | None:
        """When, after the profile began, the capacity changes next; None: never."""
        ...


@dataclass(frozen=True, slots=True)
class Fixed:
    """One capacity, always."""

    bps: int

    def rate_bps(self, elapsed_s: float) -> float:
        """See `Profile`."""
        return self.bps

    def next_change_s(self, elapsed_s: float) -> float | None:
        """See `Profile`."""
        return None


@dataclass(frozen=True, slots=True)
class Shift:
    """The paper's working day: 55, 20 and 5 Mbit/s by shift with a ripple of 15 %.

    The day begins at 6 h and passes `time_scale` times as fast as real time; the ripple does not.
    """

    time_scale: float = 1.0

    def rate_bps(self, elapsed_s: float) -> float:
        """See `Profile`."""
        hour = (SHIFT_START_H + elapsed_s * self.time_scale / 3600.0) % 24.0
        tier = SHIFT_BPS[-1][1]
        for start, bps in SHIFT_BPS:
            if hour >= start:
                tier = bps
        return tier * (1.0 + SINE_SHARE * math.sin(2.0 * math.pi * elapsed_s / SINE_PERIOD_S))

    def next_change_s(self, elapsed_s: float) -> float | None:
        """See `Profile`."""
        return (math.floor(elapsed_s / SHIFT_STEP_S) + 1) * SHIFT_STEP_S


@dataclass(frozen=True, slots=True)
class Series:
    """Recorded capacities, each for one interval, from the start again at the end."""

    rates_bps: tuple[int, ...]
    interval_s: float
    time_scale: float = 1.0

    def rate_bps(self, elapsed_s: float) -> float:
        """See `Profile`."""
        return self.rates_bps[self._step(elapsed_s) % len(self.rates_bps)]

    def next_change_s(self, elapsed_s: float) -> float | None:
        """See `Profile`."""
        step_s = self.interval_s / self.time_scale
        return (self._step(elapsed_s) + 1) * step_s

    def _step(self, elapsed_s: float) -> int:
        # A moment that was computed as a multiple of the step must not fall just short of it.
        return math.floor(elapsed_s * self.time_scale / self.interval_s + 1e-9)
