"""What a fused frame costs the ego itself, by algorithm: the pace that it can keep."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from statistics import median

from ego_agent.knowledge.answers import little
from swarm.messages import Algorithm

FRAMES = 10
"""Frames of which the median counts."""
LIGHTER = 0.25
"""Of what a whole contribution takes of the ego, what an answer about places does (measured: 0.08
in the factory, 0.44 on streets); its robot works as long for it."""
WORKED_FRAMES = 100
"""Frames of which a low processor time counts (`LITTLE`)."""


KNOWN_S = 30.0
"""For so long after its last frame it is known what an algorithm's frames cost, and after its last
contribution what these do: what was slow when the machine was busy is worth another try, also where
nobody is asked because it was."""


class OwnCosts:
    """Seconds of the ego's work a frame. The fusion thread records, the control cycle reads."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._fused_s: dict[Algorithm, float] = {}
        """When a frame was fused last..."""
        self._added_s: dict[Algorithm, float] = {}
        """...and when one with contributions was."""
        self._fixed_s: dict[Algorithm, deque[float]] = {}
        self._add_s: dict[Algorithm, deque[float]] = {}
        self._work_s: dict[Algorithm, deque[float]] = {}

    def record(
        self,
        algorithm: Algorithm,
        contributions: float,
        fixed_s: float,
        add_s: float,
        work_s: float,
    ) -> None:
        """Notes a fused frame: `fixed_s` whoever takes part, `add_s` for taking up all
        contributions, `work_s` the processor time of that. One about places counts as LIGHTER."""
        with self._lock:
            self._forget_old(algorithm)
            self._fused_s[algorithm] = self._now_s()
            self._fixed_s.setdefault(algorithm, deque(maxlen=FRAMES)).append(fixed_s)
            if contributions:
                self._added_s[algorithm] = self._now_s()
                added = self._add_s.setdefault(algorithm, deque(maxlen=FRAMES))
                added.append(add_s / contributions)
                worked = self._work_s.setdefault(algorithm, deque(maxlen=WORKED_FRAMES))
                worked.append(work_s / contributions)

    def frame_s(self, algorithm: Algorithm, contributions: int) -> float:
        """What a frame with that many contributions takes; 0 where nothing is known."""
        with self._lock:
            self._forget_old(algorithm)
            fixed = median(self._fixed_s.get(algorithm, (0.0,)))
            return fixed + contributions * median(self._add_s.get(algorithm, (0.0,)))

    def add_s(self, algorithm: Algorithm) -> float | None:
        """What taking one contribution up lasts; None where nothing is known."""
        with self._lock:
            self._forget_old(algorithm)
            known = self._add_s.get(algorithm)
            return median(known) if known else None

    def work_s(self, algorithm: Algorithm) -> float | None:
        """Processor time that one contribution takes when little else runs; None where nothing is
        known."""
        with self._lock:
            self._forget_old(algorithm)
            known = self._work_s.get(algorithm)
            return little(known) if known else None

    def _forget_old(self, algorithm: Algorithm) -> None:
        before_s = self._now_s() - KNOWN_S
        if self._fused_s.get(algorithm, before_s) < before_s:
            self._fixed_s.pop(algorithm, None)
        if self._added_s.get(algorithm, before_s) < before_s:
            self._add_s.pop(algorithm, None)
            self._work_s.pop(algorithm, None)
