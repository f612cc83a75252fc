"""Who has shown each track: whose views count for what they are, and whose for a part of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Robots = frozenset[str]

INFORMED_S = 1.5
"""So long what a robot has shown counts as better than what is seen without it."""


class Viewers:
    """Robots beside the ego, which sees all frames."""

    def __init__(self) -> None:
        self._of_late: dict[str, float] = {}
        """When each robot of the last INFORMED_S seconds has shown anything last."""
        self._best: list[Robots] = []
        """That showed each track when it was seen best."""
        self._completed: list[bool] = []
        """Whether they completed then what the ego saw; else they showed boxes of their own."""
        self._last: list[Robots | None] = []
        """Of the last partial view of each track."""
        self._whole: list[bool] = []
        """Whether each was shown in full in this frame."""

    def hear(self, time_s: float, helpers: Robots) -> None:
        """A frame in which these show something."""
        kept = {r: at for r, at in self._of_late.items() if time_s - at <= INFORMED_S}
        self._of_late = kept | dict.fromkeys(helpers, time_s)
        self._whole = [False] * len(self._best)

    def share(self, helpers: Robots) -> float:
        """How many of the robots of late these are; 1.0 where there are none."""
        return len(helpers & self._of_late.keys()) / len(self._of_late) if self._of_late else 1.0

    def partial(self, helpers: Robots) -> Mask:
        """(N,): tracks that robots of late have shown better than these may."""
        late = self._of_late.keys()
        return np.array([bool((best - helpers) & late) for best in self._best], dtype=np.bool_)

    def whole(self) -> Mask:
        """(N,): tracks that were shown in full in this frame."""
        return np.array(self._whole, dtype=np.bool_)

    def best(self, row: int) -> Robots:
        """Robots that showed a track when it was seen best."""
        return self._best[row]

    def completed(self, rows: NDArray[np.intp]) -> Mask:
        """Whether robots completed what the ego saw of tracks, when they were seen best, (K,)."""
        return np.array([self._completed[row] for row in rows], dtype=np.bool_)

    def saw(
        self, rows: NDArray[np.intp], full: Mask, by: Sequence[Robots], completes: bool
    ) -> Mask:
        """Takes down who shows tracks, fully or in part (K,); returns which are shown by others
        than their last partial view, (K,)."""
        anew = np.zeros(len(rows), dtype=np.bool_)
        for place, (row, helpers) in enumerate(zip(rows, by, strict=True)):
            self._whole[row] = bool(full[place])
            if full[place]:
                self._best[row], self._completed[row] = helpers, completes
            else:
                anew[place] = self._last[row] != helpers
                self._last[row] = helpers
        return anew

    def add(self, many: int, helpers: Robots, completes: bool) -> None:
        """New tracks that these show."""
        self._best += [helpers] * many
        self._completed += [completes] * many
        self._last += [None] * many
        self._whole += [True] * many

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Keeps these tracks, in this order."""
        self._best = [self._best[row] for row in rows]
        self._completed = [self._completed[row] for row in rows]
        self._last = [self._last[row] for row in rows]
        self._whole = [self._whole[row] for row in rows]
