"""How much of what each robot sends can be laid where it belongs.

What a robot sends is left out of a frame where nothing shows by what its pose is off while others'
poses are off (`perception.fusion.aligner`). A robot that happens to again and again is asked in
vain; what is not seen again is forgotten, and so it is tried again.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable

from ego_agent.knowledge.learnt import HALF_LIFE_S

REMEMBERED = 20.0
"""Contributions that count; those before fade."""
BELIEVED = 2.0
"""As many contributions does the belief count for that what was never tried is placed."""
MOST_ROBOTS = 1024
"""The longest unheard is dropped."""


class Placing:
    """Whole contributions that were fused or left out. The fusion thread records, the control cycle
    reads."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._counts: OrderedDict[str, tuple[float, float, float]] = OrderedDict()
        """By robot: when it was heard last, contributions then, and how many were left out."""

    def record(self, robot: str, *, placed: bool) -> None:
        """Notes that a contribution was fused, or left out."""
        with self._lock:
            count, left_out = self._known(robot)
            kept = 1.0 - 1.0 / REMEMBERED
            self._counts[robot] = (
                self._clock(), kept * count + 1.0, kept * left_out + (not placed)
            )  # fmt: skip
            self._counts.move_to_end(robot)
            if len(self._counts) > MOST_ROBOTS:
                self._counts.popitem(last=False)

    def share(self, robot: str) -> float:
        """Probability that what it sends next is placed, in (0, 1]."""
        with self._lock:
            count, left_out = self._known(robot)
        return 1.0 - left_out / (BELIEVED + count)

    def _known(self, robot: str) -> tuple[float, float]:
        at_s, count, left_out = self._counts.get(robot, (self._clock(), 0.0, 0.0))
        fades = 0.5 ** (max(0.0, self._clock() - at_s) / HALF_LIFE_S)
        return fades * count, fades * left_out
