"""What readings of a queue's counters show of the link behind it.

While a queue stands, what leaves it is what the link carries; without that the link carries at
least what went through. Both are the kernel's own counts, so a machine whose processors are busy
does not look like a narrow link.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Hashable
from dataclasses import dataclass
from itertools import pairwise

from swarm.messages import Backlog

READINGS = 3
"""Of one queue that are held against each other: the two intervals between them must agree, as a
stall of TCP after a loss looks like a narrow link in one."""
MIN_STOOD_MS = 30
"""A queue that stood for less between two readings filled no link."""
MIN_SPAN_MS = 200
"""Between readings, to show what is carried at least: a shaper lets what it would send in 20 ms
pass at once."""
MAX_SPAN_MS = 5_000
"""Readings farther apart do not tell of now."""
FLOOR_BPS = 50_000.0
"""No estimate is lower, so that a link that comes back can be found again."""
MAX_QUEUES = 512
"""Queues that are remembered; the longest unheard is dropped."""


@dataclass(frozen=True, slots=True)
class Sample:
    """What a queue shows of the link behind it."""

    rate_bps: float
    """What it carried while the queue stood; where it did not: what it carries at least."""
    filled: bool
    """The link was the limit."""
    span_s: float
    """For how long before its reading was taken it holds."""


class Queues:
    """The last readings of each queue, by any name."""

    def __init__(self) -> None:
        self._last: OrderedDict[Hashable, deque[Backlog]] = OrderedDict()

    def take(self, queue: Hashable, now: Backlog) -> Sample | None:
        """What a reading shows beside those before; None for a first one. Where a counter is
        smaller than before, who counts has begun anew: that is a first one, too."""
        held = self._last.setdefault(queue, deque(maxlen=READINGS))
        self._last.move_to_end(queue)
        if len(self._last) > MAX_QUEUES:
            self._last.popitem(last=False)
        if held and not _goes_on(held[-1], now):
            held.clear()
        held.append(now)
        first, span_ms = held[0], now.seen_ms - held[0].seen_ms
        stood = [after.stood_ms - before.stood_ms for before, after in pairwise(held)]
        if len(held) == READINGS and min(stood) >= MIN_STOOD_MS:
            rate_bps = _rate(now.stood_bytes - first.stood_bytes, sum(stood))
            return Sample(rate_bps, filled=True, span_s=span_ms * 1e-3)
        if span_ms >= MIN_SPAN_MS:
            rate_bps = _rate(now.sent_bytes - first.sent_bytes, span_ms)
            return Sample(rate_bps, filled=False, span_s=span_ms * 1e-3)
        return None


def _goes_on(before: Backlog, now: Backlog) -> bool:
    return (
        before.sent_bytes <= now.sent_bytes
        and before.stood_ms <= now.stood_ms
        and before.stood_bytes <= now.stood_bytes
        and 0 <= now.seen_ms - before.seen_ms <= MAX_SPAN_MS
    )


def _rate(size: int, ms: int) -> float:
    return max(FLOOR_BPS, size * 8e3 / ms)
