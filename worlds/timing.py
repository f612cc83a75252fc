"""When robots' scans were taken, and what that says about their clocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

MAX_SKEW_S = 0.25
"""Clocks this far apart show a car at 50 km/h 3.5 m from where it was."""
_SAME_LENGTH_S = 0.3
_ANOTHER_TIME_S = 86_400.0
"""A clock is not wrong by a day: stamps that are count from somewhere else."""


@dataclass(frozen=True, slots=True)
class Timing:
    """When the scans of one robot were taken, by its own clock."""

    robot: str
    begin_s: float
    end_s: float
    scans: int
    rate_hz: float | None
    """Of the usual step from scan to scan; None with a single scan."""
    lost: int
    """Scans that would fit into steps longer than usual."""
    disordered: int
    """Scans that were recorded after one that was taken later."""
    lag_s: float | None = None
    """Median time from taking a scan to recording it, or of a pose where that is less: a clock that
    is behind delays all that its robot stamps, a slow driver only its own scans. None where nobody
    says when it was, or where stamps are of another time than the recorder's: simulated, or played
    again."""
    trusted: bool = False
    """Whether somebody has said how far its clock is off."""

    @property
    def span_s(self) -> float:
        """From the first scan to the last."""
        return self.end_s - self.begin_s


@runtime_checkable
class Timed(Protocol):
    """A world that knows when its scans were taken."""

    timings: tuple[Timing, ...]
    """One a robot."""


def timing(
    robot: str,
    taken_ns: NDArray[np.int64],
    recorded_ns: NDArray[np.int64] | None = None,
    trusted: bool = False,
    poses_lags_s: NDArray[np.float64] | None = None,
) -> Timing:
    """Of a robot's scans, in the order of the recording: when each (N,) was taken, N >= 1, and when
    it was recorded; and how long some of its poses took from a stamp to the recording."""
    lag_s = None if recorded_ns is None else _lag((recorded_ns - taken_ns) / 1e9)
    if lag_s is not None and poses_lags_s is not None and len(poses_lags_s):
        lag_s = min(lag_s, float(np.median(poses_lags_s)))
    steps = np.diff(np.sort(taken_ns)).astype(np.int64)
    steps = steps[steps > 0]
    usual = float(np.median(steps)) if len(steps) else 0.0
    lost = int(np.maximum(np.round(steps / usual) - 1, 0).sum()) if usual else 0
    behind = taken_ns < np.maximum.accumulate(taken_ns)
    return Timing(
        robot=robot,
        begin_s=int(taken_ns.min()) / 1e9,
        end_s=int(taken_ns.max()) / 1e9,
        scans=len(taken_ns),
        rate_hz=1e9 / usual if usual else None,
        lost=lost,
        disordered=int(behind.sum()),
        lag_s=lag_s,
        trusted=trusted,
    )


def _lag(each_s: NDArray[np.float64]) -> float | None:
    low, usual, high = np.percentile(each_s, (25, 50, 75))
    steady = high - low < MAX_SKEW_S and abs(usual) < _ANOTHER_TIME_S
    return float(usual) if steady else None


def overlap_s(timings: Sequence[Timing]) -> float:
    """How long all robots recorded; negative where two of them never did at once."""
    return min(one.end_s for one in timings) - max(one.begin_s for one in timings)


def skew_by_lag(timings: Sequence[Timing]) -> tuple[str, float] | None:
    """The robot whose clock differs most from the first one's, and by how many seconds it is
    ahead, judged by when scans were recorded; None where nothing tells of a difference, or where
    somebody has looked at the clocks.

    Where one recorder heard all robots, a clock that is a second ahead takes its scans a second
    nearer to (or after) their recording.
    """
    if any(one.trusted for one in timings):
        return None
    heard = [one for one in timings if one.lag_s is not None]
    apart = [(one.robot, (heard[0].lag_s or 0.0) - (one.lag_s or 0.0)) for one in heard[1:]]
    worst = max(apart, key=lambda each: abs(each[1]), default=None)
    return worst if worst is not None and abs(worst[1]) > MAX_SKEW_S else None


def skew_by_ends(timings: Sequence[Timing]) -> tuple[str, float] | None:
    """The same, judged by recordings of one length: where both ends are apart by the same time,
    they may well have been made at once, by clocks that differ. Less than a step from scan to scan
    tells nothing: robots begin their turns at moments of their own."""
    if any(one.trusted for one in timings):
        return None
    apart = []
    for one in timings[1:]:
        begins, ends = one.begin_s - timings[0].begin_s, one.end_s - timings[0].end_s
        steps_s = (1 / each.rate_hz for each in (timings[0], one) if each.rate_hz)
        least_s = max(MAX_SKEW_S, *steps_s)
        if abs(begins - ends) < _SAME_LENGTH_S and abs(begins) > least_s:
            apart.append((one.robot, (begins + ends) / 2))
    return max(apart, key=lambda each: abs(each[1]), default=None)
