"""The cache of answers: in memory, with a copy on disk that outlives the process.

Nobody waits for the disk: it is read once, at the start, and written behind. Whatever it does,
memory goes on.
"""

from __future__ import annotations

import asyncio
import hashlib
import sqlite3
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from llm_gateway.cache_store import Entry, Store
from llm_gateway.metrics import GatewayMetrics
from swarm.log import Logger
from swarm.messages import LlmTokens

T = TypeVar("T")
MAX_CHARS = 20_000
"""Longer answers are no decisions, and are not kept."""
MAX_WRITES = 256
"""Waiting for the disk; further answers stay in memory only."""
START_S = 5.0
CLOSE_S = 2.0


class Cache:
    """Used on one event loop; `clock` gives seconds since the epoch, as it survives a restart."""

    def __init__(
        self,
        path: Path | None,
        metrics: GatewayMetrics,
        log: Logger,
        *,
        ttl_s: float = 300.0,
        entries: int = 10_000,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """`path` None keeps answers in memory only. At most `entries` stay: in memory those used
        last, on disk the newest."""
        self._store = Store(path, entries) if path else None
        self._memory: OrderedDict[str, Entry] = OrderedDict()
        self._newest: dict[str, str] = {}
        """Key of the newest answer by scene."""
        self._most = entries
        self._ttl_s = ttl_s
        self._clock = clock
        self._metrics = metrics
        self._log = log
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="cache")
        self._writes = 0
        self._moved_aside = 0
        self._complained = False

    @staticmethod
    def scene(model: str, role: str, template: str, fingerprint: str) -> str:
        """What answers for equal scenes are found by; empty without a fingerprint.

        A fingerprint is what who asks says of the scene. So that nobody leaves an answer for others
        who are asked something else, it counts within one role and one prompt's template only.
        """
        if not fingerprint:
            return ""
        return hashlib.sha256("\n".join((model, role, template, fingerprint)).encode()).hexdigest()

    async def start(self) -> None:
        """Reads what the disk has; where that fails, the cache begins empty."""
        store = self._store
        if store is None:
            return
        oldest = self._clock() - self._ttl_s
        for entry in await self._on_disk("read", lambda: store.load(oldest), START_S) or ():
            self._remember(entry)

    async def close(self) -> None:
        """Writes what waits for the disk."""
        if self._store is not None:
            await self._on_disk("close", self._store.close, CLOSE_S)
        self._thread.shutdown(wait=False)

    def exact(self, key: str) -> Entry | None:
        """The answer to an equal prompt."""
        return self._fresh(self._memory.get(key))

    def similar(self, scene: str) -> Entry | None:
        """The newest answer for an equal scene."""
        return self._fresh(self._memory.get(self._newest.get(scene, "")))

    def put(self, key: str, scene: str, model: str, text: str, used: LlmTokens) -> None:
        """Keeps an answer, unless it is very long."""
        if len(text) > MAX_CHARS:
            return
        entry = Entry(key, scene, model, text, self._clock(), used)
        self._remember(entry)
        store = self._store
        if store is None:
            return
        if self._writes >= MAX_WRITES:
            self._metrics.cache_faults.labels("dropped").inc()
            return
        self._writes += 1
        loop = asyncio.get_running_loop()
        oldest = entry.made_at - self._ttl_s
        written = self._thread.submit(store.put, entry, oldest)
        written.add_done_callback(lambda done: loop.call_soon_threadsafe(self._written, done))

    def age_s(self, entry: Entry) -> float:
        """Since the model gave an answer."""
        return max(0.0, self._clock() - entry.made_at)

    def _remember(self, entry: Entry) -> None:
        if (former := self._memory.get(entry.key)) is not None:
            self._forget(former)
        self._memory[entry.key] = entry
        if entry.scene:
            known = self._memory.get(self._newest.get(entry.scene, ""))
            if known is None or known.made_at <= entry.made_at:
                self._newest[entry.scene] = entry.key
        while len(self._memory) > self._most:
            self._forget(next(iter(self._memory.values())))

    def _forget(self, entry: Entry) -> None:
        self._memory.pop(entry.key, None)
        if self._newest.get(entry.scene) == entry.key:
            del self._newest[entry.scene]

    def _fresh(self, entry: Entry | None) -> Entry | None:
        # Either way: an answer from far in the future was made before the clock was set.
        if entry is None or abs(self._clock() - entry.made_at) > self._ttl_s:
            return None
        if entry.key in self._memory:
            self._memory.move_to_end(entry.key)
        return entry

    async def _on_disk(self, kind: str, work: Callable[[], T], limit_s: float) -> T | None:
        """Does work on the disk's thread; None where it fails or takes too long."""
        done = asyncio.get_running_loop().run_in_executor(self._thread, work)
        try:
            result = await asyncio.wait_for(done, limit_s)
        except TimeoutError:
            self._complain("slow", f"{kind} took more than {limit_s} s")
            return None
        except (sqlite3.Error, OSError) as error:
            self._complain(kind, str(error))
            return None
        self._look_aside()
        return result

    def _written(self, done: Future[None]) -> None:
        self._writes -= 1
        error = done.exception()
        if error is not None:
            self._complain("write", str(error))
        else:
            self._complained = False
        self._look_aside()

    def _complain(self, kind: str, why: str) -> None:
        """Counts a fault; logs the first one until a write succeeds again."""
        self._metrics.cache_faults.labels(kind).inc()
        if not self._complained:
            self._complained = True
            self._log.warning("cache_disk_failed", kind=kind, error=why[:300])

    def _look_aside(self) -> None:
        if self._store is not None and self._store.moved_aside != self._moved_aside:
            self._moved_aside = self._store.moved_aside
            self._metrics.cache_faults.labels("corrupt").inc()
            self._log.warning("cache_moved_aside", file=f"{self._store.path}.corrupt")
