"""The retry budget: retries are a share of the calls, so that they cannot double the load."""

from __future__ import annotations

RATIO = 0.1
"""Retries a call."""
PER_SECOND = 0.1
"""Retries that a gateway with few calls has all the same."""
MOST = 10.0
"""Retries that can be saved up."""


class RetryBudget:
    """A token bucket that calls and time fill and retries empty. `now` is monotonic seconds."""

    def __init__(self, now: float) -> None:
        self._tokens = 1.0
        self._filled = now

    def called(self) -> None:
        """Counts a first attempt."""
        self._tokens = min(MOST, self._tokens + RATIO)

    def take(self, now: float) -> bool:
        """Whether one more retry is affordable; if so, it is paid."""
        self._tokens = min(MOST, self._tokens + (now - self._filled) * PER_SECOND)
        self._filled = now
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True
