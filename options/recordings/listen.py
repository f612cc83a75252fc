"""What a running swarm says over Zenoh, in the order in which it came."""

from __future__ import annotations

import queue
import time
from dataclasses import dataclass

from deploy.state import State
from swarm.listening import listen
from swarm.messages import (
    Beacon,
    Decision,
    Detections,
    Message,
    NetState,
    SceneDescription,
)

AWAY_S = 8.0
"""The router may restart; longer than this it is gone."""
MAX_WAITING = 20_000
"""Messages; a hundred robots send 1,200 a second."""
RECORDED = (Beacon, SceneDescription, Decision, Detections, NetState)


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
        self._queue: queue.SimpleQueue[Received] = queue.SimpleQueue()
        self.lost = 0
        """Messages that found too many waiting."""
        self._away_since: float | None = None
        self._session = listen(
            state.router,
            state.spec.swarm,
            dict.fromkeys(RECORDED, self._put),
            state.spec.ego,
            on_join=lambda robot: self._put(Presence(robot, True)),
            on_leave=lambda robot: self._put(Presence(robot, False)),
            timeout_s=timeout_s,
        )

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_: object) -> None:
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

    def _put(self, message: Message | Presence) -> None:
        if self._queue.qsize() >= MAX_WAITING:
            self.lost += 1
            return
        self._queue.put(Received(message, time.time_ns()))
