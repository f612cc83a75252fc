"""What a running swarm says over Zenoh, in the order in which it came."""

from __future__ import annotations

import queue
import time
from dataclasses import dataclass
from types import TracebackType
from typing import TypeVar

from deploy.state import State
from swarm import keyspace
from swarm.messages import (
    Beacon,
    Decision,
    Detections,
    Message,
    NetState,
    SceneDescription,
)
from swarm.session import Session

AWAY_S = 8.0
"""The router may restart; longer than this it is gone."""
MAX_WAITING = 20_000
"""Messages; a hundred robots send 1,200 a second."""
M = TypeVar("M", bound=Message)


@dataclass(frozen=True, slots=True)
class Presence:
    """A robot joined or left."""

    robot: str
    alive: bool


@dataclass(frozen=True, slots=True)
class Received:
    """A message, and when it came."""

    message: Message | Presence
    came_ns: int


class Listener:
    """Listens to one swarm through its router. Use as a context manager."""

    def __init__(self, state: State, timeout_s: float) -> None:
        """Raises TransportError when the router cannot be reached in time."""
        swarm, ego = state.spec.swarm, state.spec.ego
        self._queue: queue.SimpleQueue[Received] = queue.SimpleQueue()
        self.lost = 0
        """Messages that found too many waiting."""
        self._away_since: float | None = None
        self._session = Session(state.router, swarm, timeout_s=timeout_s)
        self._session.watch_alive(
            lambda robot: self._put(Presence(robot, True)),
            lambda robot: self._put(Presence(robot, False)),
        )
        self._hear(keyspace.beacon(swarm, keyspace.ANY), Beacon)
        self._hear(keyspace.scene(swarm, keyspace.ANY), SceneDescription)
        self._hear(keyspace.decision(swarm, ego), Decision)
        self._hear(keyspace.detections(swarm, ego), Detections)
        self._hear(keyspace.net_state(swarm), NetState)

    def __enter__(self) -> Listener:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._session.close()

    def next(self, timeout_s: float) -> Received | None:
        """The next message; None when none came in time."""
        try:
            return self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def waiting(self) -> int:
        """How many messages have not been taken yet."""
        return self._queue.qsize()

    def away_s(self) -> float:
        """For how long the router has been away; 0 while it is there."""
        if self._session.links():
            self._away_since = None
            return 0.0
        now = time.monotonic()
        self._away_since = self._away_since or now
        return now - self._away_since

    def _hear(self, key: str, kind: type[M]) -> None:
        self._session.subscribe(key, kind, lambda message, _: self._put(message))

    def _put(self, message: Message | Presence) -> None:
        if self._queue.qsize() >= MAX_WAITING:
            self.lost += 1
            return
        self._queue.put(Received(message, time.time_ns()))
