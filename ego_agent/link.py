"""C(t): how many bits a second the ego's link delivers, estimated from the fusion rounds.

A maximum filter over the delivery rates of the last `WINDOW_ROUNDS` rounds, in the manner of BBR
(Cardwell et al., "BBR: Congestion-Based Congestion Control", ACM Queue 14-5, 2016, which keeps ten
round trips). A round's rate is what arrived in it, divided by the time in which any answer can have
been on its way: from the moment its robot had encoded it to its arrival (`busy_s`). As in BBR, a
round that did not fill the link cannot lower the estimate: one that is over within `LATENCY_S`
shows latency, not capacity. Rounds of comparable size vouch for each other, so that one hiccup of
a busy machine lowers nothing.

- A round without any answer says that the link is much slower than thought, or gone: each takes
  the estimate down by `TIMEOUT_DECAY`.
- Without rounds that fill the link, the estimate rises towards the prior, doubling every
  `DOUBLING_S` (BBR probes for bandwidth in the same spirit): a link that has recovered is found out
  without traffic for its own sake, and short bursts through a shaper's bucket do not mislead.

The prior is the capacity that the network controller said last that it configured (`net/state`),
else the setting. The estimate never exceeds a fresh `net/state`.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

WINDOW_ROUNDS = 10
LATENCY_S = 0.05
COMPARABLE = 0.5
"""Rounds with at least this share of a round's bytes are held against it."""
TIMEOUT_DECAY = 0.85
DOUBLING_S = 5.0
FLOOR_BPS = 50_000.0
"""The estimate stays above this, so that a link that comes back can be found again."""
STATE_FRESH_S = 5.0
"""`net/state` comes at 1 Hz; after this silence it is only a prior."""
_MIN_SPAN_S = 0.001


@dataclass(frozen=True, slots=True)
class Round:
    """One fusion round as the link saw it."""

    delivered_bytes: int
    """All bytes that arrived between the first query and the last answer, also those of answers
    to earlier rounds."""
    busy_s: float
    """The longest that the link can have been busy with them: `busy_s` of their times."""
    complete: bool
    """Every robot that was asked has answered, if only with a refusal."""

    @property
    def rate_bps(self) -> float:
        """Delivered bits a second."""
        return max(FLOOR_BPS, self.delivered_bytes * 8.0 / max(self.busy_s, _MIN_SPAN_S))

    @property
    def filled(self) -> bool:
        """The link may have been the limit."""
        return not self.complete or self.busy_s >= LATENCY_S


def busy_s(intervals: Iterable[tuple[float, float]]) -> float:
    """Seconds that lie in at least one of the intervals (start, end)."""
    total, reached = 0.0, float("-inf")
    for start, end in sorted(intervals):
        total += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return total


class LinkEstimate:
    """Thread-safe estimate of C(t). Times are `time.monotonic()` seconds, given by the caller."""

    def __init__(self, prior_bps: float) -> None:
        self._lock = threading.Lock()
        self._prior_bps = prior_bps
        self._state_at: float | None = None
        self._rounds: deque[Round] = deque(maxlen=WINDOW_ROUNDS)
        self._measured: tuple[float, float] | None = None
        """bit/s and when."""

    def add_round(self, done: Round, now_s: float) -> None:
        """Takes one round's delivery rate into the estimate."""
        with self._lock:
            if done.delivered_bytes == 0:
                if not done.complete:
                    current_bps, _ = self._capacity(now_s)
                    self._measured = (max(FLOOR_BPS, current_bps * TIMEOUT_DECAY), now_s)
                return
            self._rounds.append(done)
            if not done.filled:
                return
            least = done.delivered_bytes * COMPARABLE
            comparable = [r for r in self._rounds if r.delivered_bytes >= least]
            filled = [r.rate_bps for r in comparable if r.filled]
            if 2 * len(filled) > len(comparable):
                self._measured = (max(filled), now_s)

    def set_state(self, capacity_bps: float, now_s: float) -> None:
        """Takes the network controller's word for what it configured."""
        with self._lock:
            if self._state_at is None or self._prior_bps != capacity_bps:
                # Rounds under another configuration say nothing about this one.
                self._rounds.clear()
                self._measured = None
            self._prior_bps = capacity_bps
            self._state_at = now_s

    def capacity(self, now_s: float) -> tuple[float, str]:
        """C(t) in bit/s and where it comes from: `measured`, `net/state` or `prior`."""
        with self._lock:
            return self._capacity(now_s)

    def _capacity(self, now_s: float) -> tuple[float, str]:
        prior_bps = self._prior_bps
        configured = self._state_at is not None and now_s - self._state_at <= STATE_FRESH_S
        source = "net/state" if configured else "prior"
        if self._measured is None:
            return prior_bps, source
        measured_bps, measured_at = self._measured
        if measured_bps >= prior_bps:
            return (prior_bps, source) if configured else (measured_bps, "measured")
        doublings = min(64.0, max(0.0, now_s - measured_at) / DOUBLING_S)
        risen_bps = measured_bps * 2.0**doublings
        return (risen_bps, "measured") if risen_bps < prior_bps else (prior_bps, source)
