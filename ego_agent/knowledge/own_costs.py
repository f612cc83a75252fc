"""What a fused frame costs the ego itself, by algorithm: the pace that it can keep."""

from __future__ import annotations

import threading
from collections import deque
from statistics import median

from swarm.messages import Algorithm

FRAMES = 10
"""Frames of which the median counts."""


class OwnCosts:
    """Seconds of the ego's work a frame. The fusion thread records, the control cycle reads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._fixed_s: dict[Algorithm, deque[float]] = {}
        self._add_s: dict[Algorithm, deque[float]] = {}
        self._work_s: dict[Algorithm, deque[float]] = {}

    def record(
        self,
        algorithm: Algorithm,
        contributions: int,
        fixed_s: float,
        add_s: float,
        work_s: float,
    ) -> None:
        """Notes a fused frame: `fixed_s` whoever takes part, `add_s` for taking up all
        contributions, `work_s` the processor time of that."""
        with self._lock:
            self._fixed_s.setdefault(algorithm, deque(maxlen=FRAMES)).append(fixed_s)
            if contributions:
                for told, spent_s in ((self._add_s, add_s), (self._work_s, work_s)):
                    each = told.setdefault(algorithm, deque(maxlen=FRAMES))
                    each.append(spent_s / contributions)

    def frame_s(self, algorithm: Algorithm, contributions: int) -> float:
        """What a frame with that many contributions takes; 0 where nothing is known."""
        with self._lock:
            fixed = median(self._fixed_s.get(algorithm, (0.0,)))
            return fixed + contributions * median(self._add_s.get(algorithm, (0.0,)))

    def work_s(self, algorithm: Algorithm) -> float | None:
        """Processor time that one contribution takes; None where nothing is known."""
        with self._lock:
            known = self._work_s.get(algorithm)
            return median(known) if known else None
