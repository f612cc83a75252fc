"""Watches the queues of this process's own TCP connections of one traffic class."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress

import msgspec

from swarm.backlog import BacklogMeter
from swarm.messages import Backlog
from swarm.tcp.info import Connection, TcpInfo, connections, tcp_info
from swarm.traffic import TrafficClass

IDLE_S = 0.05
STANDING_S = 0.01
"""Between samples while a queue stands. What never stands for so long fills no link."""
LOOK_S = 0.5
"""Between looks for connections: a new one is found, and one that was closed forgotten."""
MAX_HELD = 0.2
"""Share of the time with data under way in which it may have waited for another than the link."""


class TcpWatch:
    """Samples on a thread of its own until closed, about 0.3 % of a core for one connection."""

    def __init__(
        self,
        traffic: TrafficClass = TrafficClass.FUSION,
        on_look: Callable[[Mapping[str, Backlog]], None] = lambda seen: None,
    ) -> None:
        """`on_look(seen)` hears every LOOK_S, on that thread, of the connections by peer."""
        self._traffic = traffic
        self._on_look = on_look
        self._meters: dict[Connection, _Meter] = {}
        self._past = Backlog()
        self._began_s = time.monotonic()
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tcp", daemon=True)
        self._thread.start()

    def total(self) -> Backlog:
        """Counters of all connections since the start, also of those that are closed by now."""
        with self._lock:
            counted = _sum(self._past, *(meter.read() for meter in self._meters.values()))
        seen_ms = round((time.monotonic() - self._began_s) * 1e3)
        return msgspec.structs.replace(counted, seen_ms=seen_ms)

    def close(self) -> None:
        """Ends the thread."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        look_due = time.monotonic()
        wait_s = 0.0
        while not self._stop.wait(wait_s):
            now_s = time.monotonic()
            if now_s >= look_due:
                look_due = now_s + LOOK_S
                # Without a descriptor to spare nobody can look; what is known goes on.
                with suppress(OSError):
                    self._look()
            with self._lock:
                standing = [self._sample(c, meter) for c, meter in self._meters.items()]
            wait_s = STANDING_S if any(standing) else IDLE_S

    def _look(self) -> None:
        found = set(connections(self._traffic))
        with self._lock:
            gone = self._meters.keys() - found
            self._past = _sum(self._past, *(self._meters.pop(c).read() for c in gone))
            for connection in found - self._meters.keys():
                self._meters[connection] = _Meter()
            seen = {c.peer: meter.read() for c, meter in self._meters.items()}
        self._on_look(seen)

    def _sample(self, connection: Connection, meter: _Meter) -> bool:
        info = tcp_info(connection.descriptor)
        return info is not None and meter.add(info, time.monotonic())


class _Meter:
    """Of one connection."""

    def __init__(self) -> None:
        self._meter = BacklogMeter()
        self._before: TcpInfo | None = None

    def add(self, info: TcpInfo, now_s: float) -> bool:
        """Takes a sample; returns whether the queue stands."""
        before, self._before = self._before, info
        stood_s = 0.0 if before is None else _stood_s(before, info)
        self._meter.add(now_s, info.acked_bytes, stood_s)
        return info.queued

    def read(self) -> Backlog:
        return self._meter.read()


def _stood_s(before: TcpInfo, now: TcpInfo) -> float:
    """For how long a queue stood between two samples. The kernel knows for how long data was under
    way, and that it queued where it did so at one of them."""
    busy_us, held_us = now.busy_us - before.busy_us, now.held_us - before.held_us
    if not (before.queued or now.queued) or held_us > MAX_HELD * busy_us:
        return 0.0
    return max(0, busy_us - held_us) * 1e-6


def _sum(*parts: Backlog) -> Backlog:
    return Backlog(
        sent_bytes=sum(part.sent_bytes for part in parts),
        stood_ms=sum(part.stood_ms for part in parts),
        stood_bytes=sum(part.stood_bytes for part in parts),
    )
