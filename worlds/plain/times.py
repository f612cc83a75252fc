"""When plain scans were taken, and which of them a frame shows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarm.errors import WorldError
from worlds.timing import Timing, overlap_s, skew_by_ends, timing

NAME = "times.txt"
MAX_AGE_S = 0.5
"""A frame in which a robot's newest scan is older sees nothing of that robot."""
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
        self, data: Path, taken: Mapping[str, NDArray[np.int64]], rate_hz: float | None
    ) -> None:
        """By when scans were taken: a frame shows the newest one at or before its moment, of the
        time that all robots cover. Raises WorldError where there is none."""
        self._taken = taken
        self.timings: tuple[Timing, ...] = tuple(timing(*each) for each in taken.items())
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
        return at, now_ns - int(self._taken[robot][at]) <= MAX_AGE_S * 1e9

    def _odd(self, shared_s: float) -> list[str]:
        found = [f"{t.robot} lacks {t.lost} scans between its {t.scans}" for t in self.timings]
        found = [words for words, t in zip(found, self.timings, strict=True) if t.lost]
        apart = skew_by_ends(self.timings)
        if apart is not None:
            found.append(
                f"the robots share {shared_s:.1f} s; if they recorded at once, the clock of "
                f"{apart[0]} is {abs(apart[1]):.3f} s {'ahead' if apart[1] > 0 else 'behind'}, "
                f"and its {NAME} must be moved by that"
            )
        return found
