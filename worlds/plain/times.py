"""When plain scans were taken, and which of them a frame shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarm.errors import WorldError
from swarm.geometry import Matrix
from worlds.timing import Timing, overlap_s, skew_by_ends, timing
from worlds.world_file import FILE_NAME

NAME = "times.txt"
Velocity = tuple[float, float, float]
USUAL_MAX_AGE_S = 0.5
"""What a scan's age may be where nobody says another; of slower robots, SLACK of their steps."""
SLACK = 1.5
"""Steps from scan to scan are not all alike."""
_LATEST_S = 9e9


def read_times(folder: Path, count: int) -> NDArray[np.int64] | None:
    """Of each scan, nanoseconds: a line of seconds each, as KITTI has them; None without a file.

    Raises WorldError that names the file and what is wrong with it.
    """
    path = folder / NAME
    if not path.is_file():
        return None
    try:
        words = path.read_text().split()
        seconds = np.array([float(word) for word in words])
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise WorldError(f"times {path} cannot be read: {error}") from error
    if len(seconds) != count:
        raise WorldError(f"{path} has {len(seconds)} times for {count} scans; it needs one a scan")
    if not (np.abs(seconds) < _LATEST_S).all() or (np.diff(seconds) <= 0).any():
        raise WorldError(f"{path} must hold seconds that ascend, one a line")
    return np.round(seconds * 1e9).astype(np.int64)


class FrameIndex:
    """Which scan of each robot a frame shows."""

    def __init__(
        self,
        data: Path,
        taken: Mapping[str, NDArray[np.int64]],
        trusted: Set[str] = frozenset(),
        *,
        rate_hz: float | None = None,
        max_age_s: float | None = None,
    ) -> None:
        """By when scans were taken: a frame shows the newest one at or before its moment, of the
        time that all robots cover.

        Args:
            data: what errors name.
            taken: of each robot, nanoseconds by the world's time, ascending.
            trusted: robots of which somebody has said how far their clocks are off.
            rate_hz: frames a second; None: the median of the robots' rates.
            max_age_s: a frame in which a robot's newest scan is older sees nothing of that robot;
                None: USUAL_MAX_AGE_S, and no less than SLACK of the robot's own usual step.

        Raises WorldError where all robots share no time.
        """
        self._taken = taken
        self.timings: tuple[Timing, ...] = tuple(
            timing(robot, its, trusted=robot in trusted) for robot, its in taken.items()
        )
        self._max_age_ns = {
            one.robot: round(1e9 * (max_age_s or _usual_max_age_s(one))) for one in self.timings
        }
        shared_s = overlap_s(self.timings)
        if shared_s < 0:
            spans = "; ".join(f"{t.robot} {t.begin_s:.3f} to {t.end_s:.3f} s" for t in self.timings)
            raise WorldError(f"the scans of {data} share no time: {spans}")
        self._start_ns = max(int(its[0]) for its in taken.values())
        rates = [one.rate_hz for one in self.timings if one.rate_hz]
        self.rate_hz = rate_hz or (max(0.01, round(float(np.median(rates)), 2)) if rates else 1.0)
        self.frame_count = 1 + int(shared_s * self.rate_hz + 1e-6)
        self.notes = tuple(self._odd(shared_s))

    def index(self, robot: str, frame: int) -> tuple[int, bool]:
        """The scan of a frame, and whether it is fresh enough to be shown."""
        now_ns = self._start_ns + round(frame * 1e9 / self.rate_hz)
        at = int(np.searchsorted(self._taken[robot], now_ns, side="right")) - 1
        return at, now_ns - int(self._taken[robot][at]) <= self._max_age_ns[robot]

    def velocity(self, robot: str, scan: int, poses: Sequence[Matrix]) -> Velocity:
        """Of the sensor from a scan to the next one (to the last one from the one before), m/s;
        zero of a robot with a single scan. `poses`: one a scan."""
        taken = self._taken[robot]
        if len(taken) < 2:
            return (0.0, 0.0, 0.0)
        scan = min(scan, len(taken) - 2)
        step_s = int(taken[scan + 1] - taken[scan]) / 1e9
        return difference(poses[scan], poses[scan + 1], step_s)

    def _odd(self, shared_s: float) -> list[str]:
        found = [f"{t.robot} lacks {t.lost} scans between its {t.scans}" for t in self.timings]
        found = [words for words, t in zip(found, self.timings, strict=True) if t.lost]
        apart = skew_by_ends(self.timings)
        if apart is not None:
            found.append(
                f"the robots share {shared_s:.1f} s; if they recorded at once, the clock of "
                f"{apart[0]} is {abs(apart[1]):.3f} s {'ahead' if apart[1] > 0 else 'behind'}: "
                f"[robots.{apart[0]}] of {FILE_NAME} needs clock_offset_s = {apart[1]:.3f}"
            )
        return found


def difference(before: Matrix, after: Matrix, step_s: float) -> Velocity:
    """Of what was in two places, `step_s` apart, m/s."""
    x, y, z = ((after[:3, 3] - before[:3, 3]) / step_s).tolist()
    return (x, y, z)


def _usual_max_age_s(one: Timing) -> float:
    return max(USUAL_MAX_AGE_S, SLACK / one.rate_hz if one.rate_hz else 0.0)
