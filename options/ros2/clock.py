"""How far this machine's clock is ahead of a robot's, by what messages say about themselves."""

from __future__ import annotations

import threading

SPAN_NS = 30_000_000_000


class ClockOffset:
    """The least that receipt came after publication within the last 30 to 60 seconds.

    The least is the offset of the clocks and the shortest way through the network; what a message
    took longer it waited. Safe to use from several threads.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._began_ns = 0
        self._before: int | None = None
        self._now: int | None = None

    def learn(self, published_ns: int, received_ns: int) -> None:
        """Takes a message's times, each on its own side's clock."""
        with self._lock:
            if self._now is None or not 0 <= received_ns - self._began_ns < SPAN_NS:
                self._before, self._now = self._now, None
                self._began_ns = received_ns
            took = received_ns - published_ns
            self._now = took if self._now is None else min(self._now, took)

    @property
    def ns(self) -> int | None:
        """What to add to the robot's time; None before the first message."""
        with self._lock:
            known = [took for took in (self._before, self._now) if took is not None]
            return min(known, default=None)
