"""Ends a process whose loops no longer turn, so that whatever runs it starts it again.

The process watches itself, so that it is the same in every runtime, and needs no way out of its
namespace or container.
"""

from __future__ import annotations

import asyncio
import faulthandler
import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TextIO

from swarm.log import Logger

HANG_S = 30.0
"""A loop that has not turned for so long hangs."""
LOOK_S = 1.0
SAY_S = 2.0
"""How long the last words may take: what blocks the loop may block the log, too."""
HUNG = 70
"""Exit code of a process that hung (EX_SOFTWARE of sysexits.h)."""

Turned = Callable[[], None]
"""To be called by a loop whenever it turns, on any thread."""
Loops = Callable[[str, float], Turned]
"""`LoopWatch.loop`, or `unwatched`."""


def nobody() -> None:
    """A `Turned` that tells nobody."""


def unwatched(name: str, allowed_s: float = 0.0) -> Turned:
    """For loops in a process that must not be ended, such as a test's."""
    return nobody


@dataclass(slots=True)
class _Loop:
    name: str
    limit_s: float
    turned_at: float | None = None


class LoopWatch:
    """Watches the loops of a process until it ends. One for a process; made in its `main`.

    A loop is watched from its first turn on: what comes before may take its time.
    """

    def __init__(self, log: Logger, *, hang_s: float | None = None) -> None:
        """`hang_s`: HANG_S, where no other is given."""
        self._log = log
        self._hang_s = HANG_S if hang_s is None else hang_s
        self._loops: list[_Loop] = []
        self._last_words = _unblocked_stderr()
        threading.Thread(target=self._watch, name="watch", daemon=True).start()

    def loop(self, name: str, allowed_s: float = 0.0) -> Turned:
        """What a loop calls whenever it turns; `allowed_s` is added to what it may take, for one
        that rests so long between two turns."""
        loop = _Loop(name, self._hang_s + allowed_s)
        self._loops.append(loop)

        def turned() -> None:
            loop.turned_at = time.monotonic()

        return turned

    def _watch(self) -> None:
        while True:
            # Ends the process also where a loop keeps Python's lock, so that no thread runs.
            faulthandler.dump_traceback_later(self._hang_s, file=self._last_words, exit=True)
            time.sleep(min(LOOK_S, self._hang_s / 4))
            now = time.monotonic()
            for loop in tuple(self._loops):
                if loop.turned_at is not None and now - loop.turned_at >= loop.limit_s:
                    self._end(loop, now - loop.turned_at)

    def _end(self, loop: _Loop, seconds: float) -> None:
        def say() -> None:
            self._log.error("hung", loop=loop.name, seconds=round(seconds, 1))
            with suppress(OSError, ValueError):
                faulthandler.dump_traceback(sys.stderr)

        words = threading.Thread(target=say, daemon=True)
        words.start()
        words.join(SAY_S)
        os._exit(HUNG)


def _unblocked_stderr() -> int | TextIO:
    """Standard error so that a write to it never waits, where it is a pipe or a terminal.

    A traceback that waits for a full pipe would keep the process, and whoever sets the next
    timeout waits for that traceback with Python's lock in hand.
    """
    with suppress(OSError, ValueError):
        # Opened anew: O_NONBLOCK on a copy would hold for all who share it.
        flags = os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_NOCTTY
        return os.open(f"/proc/self/fd/{sys.stderr.fileno()}", flags)
    return sys.stderr


async def keep_turning(turned: Turned) -> None:
    """Tells, until cancelled, that the event loop turns."""
    while True:
        turned()
        await asyncio.sleep(LOOK_S)
