"""Has the kernel give up connections of this process whose other end acknowledges nothing.

Zenoh closes a link to a peer that was silent for its lease once its goodbye has gone out. Where the
way is cut nothing goes out, and TCP tries again ever more rarely: half a minute after a cut of
twenty seconds the old links would still be there, and new ones be taken for more of theirs.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from swarm.tcp.info import connections, limit_silence
from swarm.traffic import TrafficClass

SILENT_MS = 10_000
"""As long as Zenoh's lease."""
LOOK_S = 2.0
"""Less than the time in which a new connection could be silent for so long."""


class GiveUp:
    """Takes care of connections as they come; `look` belongs to one thread."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._due = now()

    def look(self) -> None:
        """Looks for connections, where that is due."""
        now = self._now()
        if now < self._due:
            return
        self._due = now + LOOK_S
        for cls in TrafficClass:
            for one in connections(cls):
                limit_silence(one.descriptor, SILENT_MS)
