"""Simulated time: what happens when, and who works on which processor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from heapq import heappop, heappush
from itertools import count

Action = Callable[[], None]


class Agenda:
    """What is to happen, in the order of its time; what is to happen at once in that of `at`."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._numbers = count()
        self._planned: list[tuple[float, int, Action]] = []

    def at(self, time_s: float, action: Action) -> None:
        """Lets something happen at a time, at the earliest now."""
        heappush(self._planned, (max(time_s, self.now_s), next(self._numbers), action))

    def run(self) -> None:
        """Lets everything happen."""
        while self._planned:
            self.now_s, _, action = heappop(self._planned)
            action()


class Processors:
    """Processors that take up jobs in the order in which they come, each to its end."""

    def __init__(self, agenda: Agenda, number: int) -> None:
        self._agenda = agenda
        self._free = number
        self._waiting: deque[tuple[float, Action]] = deque()

    def work(self, seconds: float, done: Action) -> None:
        """Works so long as soon as a processor is free, and tells."""
        self._waiting.append((seconds, done))
        self._next()

    def _next(self) -> None:
        while self._free and self._waiting:
            seconds, done = self._waiting.popleft()
            self._free -= 1
            self._agenda.at(self._agenda.now_s + seconds, partial(self._ended, done))

    def _ended(self, done: Action) -> None:
        self._free += 1
        done()
        self._next()
