"""Everybody who looks: when they are woken, and what they may do."""

from __future__ import annotations

import asyncio
import hmac
import secrets
from collections.abc import AsyncGenerator, Callable

import msgspec

from options.console.board import Board, now_s

STEP_S = 1 / 30
"""Changes come at most this often."""
HEARTBEAT_S = 1.0
"""Without a change a viewer still hears that the console is there."""
MAX_VIEWERS = 32
"""Of all egos."""


class Viewer:
    """One open page."""

    def __init__(self) -> None:
        self.wake = asyncio.Event()
        self.csrf = secrets.token_urlsafe(32)


class Hub:
    """Streams the board to its viewers, each at his own pace. Lives on one event loop."""

    def __init__(self, board: Board, look: Callable[[int], None]) -> None:
        """`look(viewers)` hears how many there are whenever that changes."""
        self._board = board
        self._look = look
        self._viewers: set[Viewer] = set()
        self._loop = asyncio.get_running_loop()
        self._woken_at = 0.0
        self._pending = False
        self._closed = False
        board.on_change = self._changed

    @property
    def viewers(self) -> int:
        """How many look."""
        return len(self._viewers)

    def may_control(self, csrf: str) -> bool:
        """Whether this is the token of a page that is open now."""
        shown = csrf.encode()
        return any(hmac.compare_digest(shown, v.csrf.encode()) for v in self._viewers)

    def close(self) -> None:
        """Ends all streams."""
        self._closed = True
        self._wake()

    async def stream(self) -> AsyncGenerator[bytes]:
        """Server-sent events for one viewer: the whole state, then changes.

        Each is one JSON object: `now` (the console's clock, seconds since the epoch) and what
        `Board.since` gives; the first one also holds `csrf`, and `full`: forget what you knew.
        While the viewer takes his time with an event, changes gather on the board, where newer
        values replace older ones.
        """
        viewer = Viewer()
        self._viewers.add(viewer)
        self._look(len(self._viewers))
        try:
            number, found = self._board.since(0)
            head = b'"full":true,"csrf":' + msgspec.json.encode(viewer.csrf) + b","
            while not self._closed:
                yield b'data: {"now":%.3f,%b%b}\n\n' % (now_s(), head, found)
                head = b""
                try:
                    async with asyncio.timeout(HEARTBEAT_S):
                        await viewer.wake.wait()
                except TimeoutError:
                    pass
                viewer.wake.clear()
                number, found = self._board.since(number)
        finally:
            self._viewers.discard(viewer)
            self._look(len(self._viewers))

    def _changed(self) -> None:
        """On any thread: one wake-up for all changes of a step."""
        if self._viewers and not self._pending and not self._closed:
            self._pending = True
            self._loop.call_soon_threadsafe(self._schedule)

    def _schedule(self) -> None:
        self._loop.call_at(max(self._loop.time(), self._woken_at + STEP_S), self._wake)

    def _wake(self) -> None:
        self._woken_at = self._loop.time()
        self._pending = False
        for viewer in self._viewers:
            viewer.wake.set()
