"""For how long a queue had more to send than it could, and what it sent meanwhile.

While a queue stands, what leaves it is what the link behind it carries; what leaves an empty queue
only shows how much was asked for (Jain and Dovrolis, "Pathload", PAM 2002, use the same evidence).
Whoever can see a queue samples it, and tells two counters that only grow: two of their readings
give a rate, however many between them were lost.
"""

from __future__ import annotations

from dataclasses import dataclass

from swarm.messages import Backlog

MAX_GAP_S = 0.06
"""Of samples farther apart than this nobody knows what happened between them: on a busy machine the
sampler itself comes late, and a queue may have emptied and filled again."""


@dataclass(frozen=True, slots=True)
class QueueSample:
    """A queue at one moment: `at_s` is `time.monotonic()` seconds."""

    at_s: float
    waiting: bool
    """Bytes wait that could leave at once if the link were wider."""
    sent_bytes: int
    """Counter of what has left it."""


class BacklogMeter:
    """Adds up the times between samples at both of which the queue stood."""

    def __init__(self) -> None:
        self._before: QueueSample | None = None
        self._began_s: float | None = None
        self._seconds = 0.0
        self._bytes = 0
        self._sent = 0

    def add(self, now: QueueSample, *, between: bool = True) -> None:
        """Takes a sample; `between` is False where the queue is known to have stood still for
        another reason, or to have been empty, since the last one. A counter that is smaller than
        before has begun anew: its queue is another one."""
        before, self._before = self._before, now
        if self._began_s is None:
            self._began_s = now.at_s
        if before is None or now.sent_bytes < before.sent_bytes:
            return
        sent = now.sent_bytes - before.sent_bytes
        self._sent += sent
        gap_s = now.at_s - before.at_s
        if between and before.waiting and now.waiting and gap_s <= MAX_GAP_S:
            self._seconds += gap_s
            self._bytes += sent

    def read(self) -> Backlog:
        """The counters so far."""
        seen_s = 0.0
        if self._before is not None and self._began_s is not None:
            seen_s = self._before.at_s - self._began_s
        return Backlog(
            seen_ms=round(seen_s * 1e3),
            sent_bytes=self._sent,
            stood_ms=round(self._seconds * 1e3),
            stood_bytes=self._bytes,
        )
