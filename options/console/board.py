"""What is known now, by name, and what of it is new to a viewer."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec

HISTORY, FAULTS = "history", "faults"
KEPT = {HISTORY: 1200, FAULTS: 200}
"""Entries of each list."""
MAX_GONE = 1000
"""Names without a value that viewers may not have heard of yet; names come from the network."""
_ENCODER = msgspec.json.Encoder()


class Board:
    """Named values and two lists, each change with a number. Threads may share it.

    A viewer who has seen number n gets the newest value of every name that changed after n: one
    who comes rarely gets fewer states, never older ones, and nothing is kept for him.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._number = 0
        self._values: dict[str, _Entry] = {}
        self._lists: dict[str, deque[_Entry]] = {n: deque(maxlen=k) for n, k in KEPT.items()}
        self._last: tuple[int, int, bytes] = (-1, -1, b"")
        self.on_change: Callable[[], None] = lambda: None
        """Called after every change, on the thread that made it; must return at once."""

    def put(self, name: str, value: Any) -> None:
        """Replaces a value; None says that there is none any more."""
        with self._lock:
            self._number += 1
            self._values[name] = _Entry(self._number, value)
            if value is None:
                self._forget_gone()
        self.on_change()

    def append(self, name: str, value: Any) -> None:
        """Adds to one of the lists."""
        with self._lock:
            self._number += 1
            self._lists[name].append(_Entry(self._number, value))
        self.on_change()

    def since(self, number: int) -> tuple[int, bytes]:
        """The number to ask with next time, and what changed after `number` as JSON members:
        `"state": {name: value}, "history": [...], "faults": [...]`."""
        with self._lock:
            if self._last[:2] == (number, self._number):
                return self._number, self._last[2]
            state = b",".join(
                b'"%b":%b' % (name.encode(), entry.json())
                for name, entry in self._values.items()
                if entry.number > number
            )
            lists = b"".join(
                b',"%b":[%b]'
                % (name.encode(), b",".join(e.json() for e in entries if e.number > number))
                for name, entries in self._lists.items()
            )
            found = b'"state":{%b}%b' % (state, lists)
            # Viewers who keep up all ask for the same.
            self._last = (number, self._number, found)
            return self._number, found

    def _forget_gone(self) -> None:
        gone = [name for name, entry in self._values.items() if entry.gone]
        if len(gone) > MAX_GONE:
            del self._values[min(gone, key=lambda name: self._values[name].number)]


class _Entry:
    """One value, and its JSON once somebody has asked for it."""

    __slots__ = ("_json", "_value", "number")

    def __init__(self, number: int, value: Any) -> None:
        self.number = number
        self._value = value
        self._json: bytes | None = None

    @property
    def gone(self) -> bool:
        """Whether it says that there is no value."""
        return self._value is None

    def json(self) -> bytes:
        if self._json is None:
            self._json = _ENCODER.encode(self._value)
        return self._json


def now_s() -> float:
    """Seconds since the epoch on this host's clock: the console's times of receipt."""
    return round(time.time(), 3)
