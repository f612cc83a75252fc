"""What a piece of work takes: time that passes, and time of a processor."""

from __future__ import annotations

import time


class Stopwatch:
    """Runs from when it is made, for the thread that made it."""

    def __init__(self) -> None:
        self._begun_s = time.perf_counter()
        self._worked_s = time.thread_time()

    def passed_ms(self) -> float:
        """Milliseconds since then."""
        return (time.perf_counter() - self._begun_s) * 1e3

    def worked_ms(self) -> float:
        """Milliseconds for which a processor worked for the thread since then."""
        return (time.thread_time() - self._worked_s) * 1e3
