"""Places for queries at a server, shared among those who ask: nobody's many keep out another's one.

Who asks is what a request says; where processes are not known by certificates, a stranger may say
anything, and has then as many shares as it has names.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from typing import Generic, TypeVar

T = TypeVar("T")


class Places(Generic[T]):
    """Queries that wait or are being answered, by asker. Safe for several threads."""

    def __init__(self, limit: int, each: int, *, newest_first: bool) -> None:
        """`limit`: of all that wait or are being answered. `each`: of those of one asker that are
        answered at the same time. `newest_first`: an old query is worth less than a new one."""
        self._limit = limit
        self._each = each
        self._newest_first = newest_first
        self._waiting: list[tuple[str, T, float]] = []
        """The oldest first."""
        self._answering: Counter[str] = Counter()
        self._open = True
        self._changed = threading.Condition()

    def add(self, asker: str, item: T, due: float = math.inf) -> T | None:
        """Takes a query, which is answered too late after `due`; returns the one that has to go for
        it, which may be itself.

        That is one of the asker who has the most, of those that wait the oldest; among as many, the
        newest one goes, or with `newest_first` the oldest.
        """
        with self._changed:
            if not self._open:
                return item
            held = self._answering + Counter(name for name, _, _ in self._waiting)
            if held.total() < self._limit:
                self._waiting.append((asker, item, due))
                return None
            held[asker] += 1
            most = max((held[name] for name, _, _ in self._waiting), default=0)
            if held[asker] > most or (held[asker] == most and not self._newest_first):
                own = [i for i, (name, _, _) in enumerate(self._waiting) if name == asker]
                if not (self._newest_first and own):
                    return item
                loser = own[0]
            else:
                loser = next(
                    i for i, (name, _, _) in enumerate(self._waiting) if held[name] == most
                )
            _, gone, _ = self._waiting.pop(loser)
            self._waiting.append((asker, item, due))
            return gone

    def next(self) -> tuple[str, T] | None:
        """The next query to answer: of the askers for whom the least is being done, the one whose
        deadline is the earliest. None where there is none. `done` must follow."""
        with self._changed:
            first: dict[str, tuple[int, float, int]] = {}
            for i, (name, _, due) in enumerate(self._waiting):
                if self._answering[name] < self._each and (self._newest_first or name not in first):
                    first[name] = (self._answering[name], due, -i if self._newest_first else i)
            if not first:
                return None
            asker, item, _ = self._waiting.pop(abs(min(first.values())[2]))
            self._answering[asker] += 1
            return asker, item

    def ahead(self) -> int:
        """How many wait or are being answered."""
        with self._changed:
            return len(self._waiting) + self._answering.total()

    def done(self, asker: str) -> None:
        """A query of this asker was answered, or given up."""
        with self._changed:
            self._answering[asker] -= 1
            self._answering += Counter()  # Without those at zero.
            self._changed.notify_all()

    def wanted(self, asker: str) -> bool:
        """Whether somebody else waits who may be answered at once."""
        with self._changed:
            return any(
                name != asker and self._answering[name] < self._each for name, _, _ in self._waiting
            )

    def drain(self, until: float) -> bool:
        """Takes nothing from now on and waits until all is answered, or the monotonic time `until`
        has come; returns whether that was in time."""
        with self._changed:
            self._open = False
            return self._changed.wait_for(
                lambda: not self._waiting and not self._answering,
                max(0.0, until - time.monotonic()),
            )

    def close(self) -> None:
        """Takes nothing from now on and forgets who waits."""
        with self._changed:
            self._open = False
            self._waiting.clear()
            self._changed.notify_all()
