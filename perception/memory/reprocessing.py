"""A memory that takes up what comes late as if it had come in time.

Measurements out of sequence (Bar-Shalom, "Update with out-of-sequence measurements in tracking",
IEEE TAES 38-3, 2002) are reprocessed here, which is exact: what was known before each of the last
frames is kept; a frame that is told anew takes the place of the first telling, and those after it
are taken up again.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from dataclasses import dataclass

from perception.detector.config import configuration
from perception.memory.memory import Frame, Memory, Remembered

KEPT_S = 0.6
"""How far back a frame may be told anew: each one in between takes some milliseconds."""


@dataclass(slots=True)
class _Past:
    frame: Frame
    before: Memory
    """What was known before it."""


class ReprocessingMemory:
    """See the module. For one thread."""

    def __init__(self, usual_speed_m_s: float, tallest_m: float = math.inf) -> None:
        """See `Memory`."""
        self._memory = Memory(usual_speed_m_s, tallest_m)
        self._past: deque[_Past] = deque()

    @classmethod
    def of_detector(cls, name: str) -> ReprocessingMemory:
        """See `Memory.of_detector`."""
        of = configuration(name)
        return cls(of.usual_speed_m_s, of.tallest_m)

    def clear(self) -> None:
        """See `Memory.clear`."""
        self._memory.clear()
        self._past.clear()

    def suspected(self) -> Remembered:
        """See `Memory.suspected`."""
        return self._memory.suspected()

    def holds(self, time_s: float) -> bool:
        """Whether a frame of that time may be told anew."""
        return any(past.frame.time_s == time_s for past in self._past)

    def update(self, frame: Frame) -> Remembered:
        """Takes up the newest frame, or one that `holds` anew; returns what is there at the newest
        frame's time by all that is known."""
        if not self.holds(frame.time_s):
            if self._past and frame.time_s < self._past[-1].frame.time_s:
                self._past.clear()  # The clock was put back.
            return self._take(frame)
        told = self._memory
        later: list[Frame] = []
        while (past := self._past.pop()).frame.time_s != frame.time_s:
            later.append(past.frame)
        self._memory = past.before
        self._memory.number_after(told)
        self._take(frame)
        for one in reversed(later):
            self._take(one)
        return self._memory.recognise(told)

    def _take(self, frame: Frame) -> Remembered:
        while self._past and frame.time_s - self._past[0].frame.time_s > KEPT_S:
            self._past.popleft()
        self._past.append(_Past(frame, copy.deepcopy(self._memory)))
        return self._memory.update(frame)
