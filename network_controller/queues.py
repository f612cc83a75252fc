"""Samples the queues of all shaped links, more often than states are published."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Protocol

from network_controller.drivers.netlink import ClassQueue, ClassReader
from network_controller.model import Link, Queue
from swarm.backlog import BacklogMeter
from swarm.log import Logger
from swarm.messages import Backlog
from swarm.traffic import TrafficClass

IDLE_S = 0.05
STANDING_S = 0.01
"""Between samples while a queue stands."""
MAX_GAP_S = 0.06
"""Of samples farther apart than this nobody knows whether the queue stood between them."""
COST = 0.01
"""Share of a core that sampling may take: with many links it comes less often."""
RETRY_S = 5.0


class Reader(Protocol):
    """Where the counters come from."""

    def read(self, queue: Queue) -> Mapping[TrafficClass, ClassQueue]:
        """See `ClassReader.read`."""
        ...

    def close(self) -> None:
        """See `ClassReader.close`."""
        ...


class QueueWatch:
    """For how long each class's queue has stood, and what left it meanwhile."""

    def __init__(self, log: Logger) -> None:
        self._log = log
        self._watched: Mapping[Link, Queue] = {}
        self._meters: dict[tuple[Link, TrafficClass], _Meter] = {}
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Samples from now on, in the network namespace of the calling thread."""
        self._thread = threading.Thread(target=self._run, name="queues", daemon=True)
        self._thread.start()

    def watch(self, queues: Mapping[Link, Queue]) -> None:
        """The links to sample from now on, and where they queue. A link that is sampled no longer
        is forgotten: its counters begin anew."""
        with self._lock:
            self._watched = dict(queues)
            self._meters = {k: m for k, m in self._meters.items() if k[0] in queues}

    def read(self, link: Link) -> Mapping[TrafficClass, Backlog]:
        """The counters of a link's classes so far."""
        with self._lock:
            return {
                traffic: meter.read() for (of, traffic), meter in self._meters.items() if of == link
            }

    def close(self) -> None:
        """Samples no more."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                reader = ClassReader()
                try:
                    self._sample(reader)
                finally:
                    reader.close()
            except OSError as error:
                # States go out without these counters; egos have TCP's view.
                self._log.warning("queues_unread", error=str(error))
                self._stop.wait(RETRY_S)

    def _sample(self, reader: Reader) -> None:
        wait_s = 0.0
        while not self._stop.wait(wait_s):
            begun_s = time.thread_time()
            with self._lock:
                watched = dict(self._watched)
            standing = False
            for link, queue in watched.items():
                standing |= self._add(link, reader.read(queue), time.monotonic())
            took_s = time.thread_time() - begun_s
            wait_s = max(STANDING_S if standing else IDLE_S, took_s / COST)

    def _add(self, link: Link, seen: Mapping[TrafficClass, ClassQueue], now_s: float) -> bool:
        """Takes a sample; returns whether a queue stands."""
        with self._lock:
            if link not in self._watched:
                return False
            for traffic, queue in seen.items():
                self._meters.setdefault((link, traffic), _Meter()).add(queue, now_s)
        return any(queue.waiting_bytes > 0 for queue in seen.values())


class _Meter:
    """Of one class."""

    def __init__(self) -> None:
        self._meter = BacklogMeter()
        self._waiting_since_s: float | None = None

    def add(self, queue: ClassQueue, now_s: float) -> None:
        # What waited at the last sample waited, or was sent at the link's rate, until now.
        since_s = self._waiting_since_s
        gap_s = 0.0 if since_s is None else now_s - since_s
        self._meter.add(now_s, queue.sent_bytes, gap_s if gap_s <= MAX_GAP_S else 0.0)
        self._waiting_since_s = now_s if queue.waiting_bytes else None

    def read(self) -> Backlog:
        return self._meter.read()
