"""The links of the scenarios: what C(t) is at each moment."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from network_controller.mahimahi import read_trace
from network_controller.profiles import Fixed, Profile, Series, Shift
from research.evaluation.windows.cell import STEP_S
from worlds.sample import data_folder

WINDOW_S = 5.0
"""A decision holds so long: the paper's control cycle."""
TELEMETRY_SHARE = 0.85
"""Of the link, that telemetry uses in the paper's third motivating snapshot."""
LOW_TIER_BPS = 5e6
SHIFT_TIERS = 4
"""Of six hours, in a day."""
TRACES = Path("traces")
TRACE_STEP_S = 1.0
"""Capacity is told by the second."""


@dataclass(frozen=True, slots=True)
class Link:
    """A link's capacity by time since its scenario began."""

    name: str
    profile: Profile
    share: float = 1.0
    """What telemetry leaves."""
    lag_s: float = 0.0
    """How old what an ego knows of it is: a controller tells at once, what is measured is past."""

    def rate_bps(self, elapsed_s: float) -> float:
        """C(t) in bit/s; at least 1."""
        return max(1.0, self.share * self.profile.rate_bps(elapsed_s))

    def mean_bps(self, begin_s: float, end_s: float) -> float:
        """The mean of C(t) in a stretch of time, bit/s."""
        count = max(1, round((end_s - begin_s) / STEP_S))
        return sum(self.rate_bps(begin_s + STEP_S * i) for i in range(count)) / count

    def known_bps(self, elapsed_s: float) -> float:
        """What an ego takes C(t) to be, bit/s: what it is, or its mean over the lag."""
        if not self.lag_s:
            return self.rate_bps(elapsed_s)
        return self.mean_bps(elapsed_s - self.lag_s, elapsed_s)


def shift(telemetry: bool = False) -> Link:
    """The paper's working day, six hours of it in each control window; `telemetry` takes
    TELEMETRY_SHARE of it."""
    scale = 24 / SHIFT_TIERS * 3600 / WINDOW_S
    left = 1 - TELEMETRY_SHARE if telemetry else 1.0
    return Link("shift-85" if telemetry else "shift", Shift(scale), left)


def low_tier_with_telemetry() -> Link:
    """What telemetry leaves of the lowest tier, always."""
    return Link("low-85", Fixed(round(LOW_TIER_BPS)), 1 - TELEMETRY_SHARE)


def recorded() -> list[Link]:
    """The recorded links in the data folder (worlds.sample), by name; none where there are
    none. A step lasts a second, and an ego knows the mean of the control window before. Raises
    NetworkError for a file (*.down, *.up) that is no recording."""
    folder = data_folder(TRACES)
    if folder is None:
        return []
    return [
        Link(path.name, Series(read_trace(path, TRACE_STEP_S), TRACE_STEP_S), lag_s=WINDOW_S)
        for path in sorted(folder.iterdir())
        if path.suffix in (".down", ".up")
    ]
