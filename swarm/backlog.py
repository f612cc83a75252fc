"""For how long a queue had more to send than it could, and what it sent meanwhile.

While a queue stands, what leaves it is what the link behind it carries; what leaves an empty queue
only shows how much was asked for (Jain and Dovrolis, "Pathload", PAM 2002, use the same evidence).
Whoever can see a queue samples it, and tells counters that only grow: two of their readings give a
rate, however many between them were lost.
"""

from __future__ import annotations

from swarm.messages import Backlog


class BacklogMeter:
    """Adds up the counters of one queue."""

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._at_s = 0.0
        self._counter = 0
        self._sent = 0
        self._stood_s = 0.0
        self._stood_bytes = 0

    def add(self, at_s: float, counter: int, stood_s: float) -> None:
        """Takes a sample: the time (`time.monotonic()` seconds), the queue's counter of bytes that
        have left it, and for how long of the time since the last sample it stood. A counter that
        is smaller than before has begun anew: its queue is another one."""
        if self._began_s is None:
            self._began_s = at_s
        elif counter >= self._counter:
            self._sent += counter - self._counter
            if stood_s > 0.0:
                self._stood_s += stood_s
                self._stood_bytes += counter - self._counter
        self._at_s, self._counter = at_s, counter

    def read(self) -> Backlog:
        """The counters so far."""
        seen_s = 0.0 if self._began_s is None else self._at_s - self._began_s
        return Backlog(
            seen_ms=round(seen_s * 1e3),
            sent_bytes=self._sent,
            stood_ms=round(self._stood_s * 1e3),
            stood_bytes=self._stood_bytes,
        )
