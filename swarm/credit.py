"""How many parts of an answer may be under way: the asker says so, as only it sees the slow link.

Between a server and the asker lie the queues of Zenoh and of the kernel, which hold megabytes. A
server that sent all it has would fill them within milliseconds: the router would stop reading
(its few receiving threads wait for the slow link, and control traffic waits with them), and what
nobody wants any more would occupy the link for many seconds. So each side's state is small: the
server sends as far as its credit goes, the asker gives more when all of it has come.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from swarm.chunks import Assembly

FIRST_PARTS = 4
MAX_PARTS_UNDER_WAY = 16
"""Of one answer: 256 kB, which 41 Mbit/s carry in QUICK_S."""
QUICK_S = 0.05
"""Credit that came back this fast is doubled: what is under way then is at most twice what the
link carries in this time, for all answers together."""
SLOW_S = 0.2
"""Credit that took longer is halved, down to one part."""
STALL_S = 10.0
"""A server waits no longer than this for credit: Zenoh's lease, after which an asker that is cut
off counts as gone."""
SHARED_STALL_S = 2.0
"""...and no longer than this where somebody else waits for its thread: a part takes 1.3 s at
100 kbit/s."""


class Window:
    """The credit that one process gives at a time; all its answers come over one link."""

    def __init__(self) -> None:
        self._parts = FIRST_PARTS
        self._lock = threading.Lock()

    @property
    def parts(self) -> int:
        """Number of parts of one answer that may be under way."""
        return self._parts

    def note(self, seconds: float, *, may_grow: bool) -> None:
        """Learns how long it took until all parts had come for which credit was given."""
        with self._lock:
            if seconds < QUICK_S and may_grow:
                self._parts = min(2 * self._parts, MAX_PARTS_UNDER_WAY)
            elif seconds > SLOW_S:
                self._parts = max(self._parts // 2, 1)


class Download:
    """One answer on its way to its asker. Used by one thread at a time."""

    def __init__(self, window: Window, give: Callable[[int], None]) -> None:
        """`give(parts)` tells the server how many parts it may have sent in all."""
        self.first = window.parts
        self.assembly = Assembly()
        self._window = window
        self._give = give
        self._given = self.first
        self._since: float | None = None
        """When credit was given; for the first credit when its first part came, as the time before
        that is the server's work, too."""

    def add(self, attachment: bytes, payload: bytes) -> bytes | None:
        """Takes one part, and gives more credit when what was given is used up; returns the whole
        answer with the last part.

        Raises MessageError when the part is not valid.
        """
        whole = self.assembly.add(attachment, payload)
        now = time.monotonic()
        if self._since is None:
            self._since = now
        if self.assembly.parts < self._given and whole is None:
            return None
        self._window.note(now - self._since, may_grow=self._given > self.first)
        if whole is None:
            self._since = now
            self._given += self._window.parts
            self._give(self._given)
        return whole


class Credits:
    """The credit of the answers that one server has under way; safe for several threads."""

    def __init__(self) -> None:
        self._parts: dict[int, int] = {}
        self._closed = False
        self._changed = threading.Condition()

    def open(self, token: int, parts: int) -> None:
        """Begins an answer; one that begins after `close_all` has no credit."""
        with self._changed:
            if not self._closed:
                self._parts[token] = parts

    def close(self, token: int) -> None:
        """Ends an answer, however it went."""
        with self._changed:
            self._parts.pop(token, None)
            self._changed.notify_all()

    def give(self, token: int, parts: int) -> None:
        """Notes the asker's credit; nothing for an answer that is not under way."""
        with self._changed:
            if token in self._parts:
                self._parts[token] = max(self._parts[token], parts)
                self._changed.notify_all()

    def wait(
        self, token: int, parts: int, until: float, wanted: Callable[[], bool] = lambda: False
    ) -> bool:
        """Waits until so many parts may have been sent; False when that has not come at the
        monotonic time `until` or STALL_S from now, when the answer was closed, or after
        SHARED_STALL_S where the thread is `wanted` for somebody else."""
        begun = time.monotonic()

        def given() -> bool:
            return self._parts.get(token, parts) >= parts

        with self._changed:
            while not given() and (now := time.monotonic()) < min(until, begun + STALL_S):
                if now - begun >= SHARED_STALL_S and wanted():
                    return False
                self._changed.wait_for(given, min(until - now, SHARED_STALL_S))
            return self._parts.get(token, 0) >= parts and time.monotonic() < until

    def close_all(self) -> None:
        """Ends every answer, also those to come: their senders stop."""
        with self._changed:
            self._closed = True
            self._parts.clear()
            self._changed.notify_all()
