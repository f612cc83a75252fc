"""The cache of answers: recent ones in memory, all on disk.

The event loop never waits for the disk longer than a moment: reads are given up, and writes are
done behind. Whatever the disk does, memory goes on.
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
MEMORY_ENTRIES = 1024
READ_S = 0.05
"""A disk that takes longer to read is of no use; a model call follows anyway."""
MAX_WRITES = 256
"""Waiting for the disk; further answers stay in memory only."""
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
        """`path` None keeps answers in memory only."""
        self._store = Store(path, entries) if path else None
        self._memory: OrderedDict[str, Entry] = OrderedDict()
        self._newest: dict[str, str] = {}
        """Key of the newest answer in memory by scene."""
        self._most = min(entries, MEMORY_ENTRIES)
        self._ttl_s = ttl_s
        self._clock = clock
        self._metrics = metrics
        self._log = log
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="cache")
        self._writes = 0
        self._moved_aside = 0
        self._complained = False

    @staticmethod
    def scene(model: str, fingerprint: str) -> str:
        """What answers for equal scenes are found by; empty without a fingerprint."""
        if not fingerprint:
            return ""
        return hashlib.sha256(f"{model}\n{fingerprint}".encode()).hexdigest()

    async def start(self) -> None:
        """Opens the disk's file; where that fails, memory alone is used until it can be."""
        if self._store is not None:
            await self._on_disk("open", self._store.open, CLOSE_S)

    async def close(self) -> None:
        """Writes what waits for the disk."""
        if self._store is not None:
            await self._on_disk("close", self._store.close, CLOSE_S)
        self._thread.shutdown(wait=False)

    def exact(self, key: str) -> Entry | None:
        """The answer of an equal prompt, if it is in memory."""
        return self._fresh(self._memory.get(key))

    def similar(self, scene: str) -> Entry | None:
        """The newest answer of an equal scene, if it is in memory."""
        return self._fresh(self._memory.get(self._newest.get(scene, "")))

    async def load(self, key: str, scene: str, usable: Callable[[Entry], bool]) -> None:
        """Brings what the disk has for a prompt or a scene into memory.

        `usable` judges it first: the file may have been damaged or written by another version.
        """
        store = self._store
        if store is None:
            return
        found = await self._on_disk("read", lambda: store.find(key, scene), READ_S)
        for entry in found or ():
            if entry.key not in self._memory and self._fresh(entry) and usable(entry):
                self._remember(entry)

    def put(self, key: str, scene: str, model: str, text: str, used: LlmTokens) -> None:
        """Keeps an answer."""
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
        self._memory[entry.key] = entry
        self._memory.move_to_end(entry.key)
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
