"""The circuit breaker: a model that keeps failing is left alone for a while.

Closed lets everything through. After `failures` failed calls in a row it opens and lets nothing
through for `open_s` seconds. Then it is half open: one call, the probe, decides.
"""

from __future__ import annotations

from typing import Literal

State = Literal["closed", "half_open", "open"]


class Breaker:
    """`now` is monotonic seconds."""

    def __init__(self, failures: int, open_s: float) -> None:
        self._allowed = failures
        self._open_s = open_s
        self._failed = 0
        self._until = 0.0
        self._why = ""
        self.state: State = "closed"

    def refusal(self, now: float) -> str:
        """Why a new call may not be made; empty where it may."""
        if self.state == "closed" or (self.state == "open" and now >= self._until):
            return ""
        if self.state == "half_open":
            return f"the breaker lets one request probe the model after: {self._why}"
        return f"the breaker is open for another {self._until - now:.1f} s after: {self._why}"

    @property
    def trouble(self) -> str:
        """Why the model is left alone, until it answers again; empty while it is not."""
        return "" if self.state == "closed" else self._why

    def admit(self) -> bool:
        """Takes a call that was not refused; returns whether it is the probe."""
        if self.state == "closed":
            return False
        self.state = "half_open"
        return True

    def succeeded(self) -> None:
        """The model answered, whatever it said."""
        self._failed = 0
        self.state = "closed"

    def failed(self, now: float, why: str, *, probe: bool) -> bool:
        """The model failed or hung; returns whether this opened the breaker."""
        self._failed += 1
        tripped = probe or (self.state == "closed" and self._failed >= self._allowed)
        if tripped:
            self.state = "open"
            self._until = now + self._open_s
            self._why = why
        return tripped

    def abandoned(self) -> None:
        """The probe ended without a verdict: the next call is one."""
        if self.state == "half_open":
            self.state = "open"
