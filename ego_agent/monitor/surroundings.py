"""The part of the floor that an ego listens to: a large site costs it what its neighbours do.

Beacons come from wherever they count in the unified scene: of robots in range, of those that
approach, and of those that others may take for things. Scenes come from robots that may take part.
Robots that do not say in which cell they are, are heard wherever they are.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

from swarm import keyspace
from swarm.areas import Cell, cells_of_disc, cells_of_square, name_of
from swarm.errors import CoAdaptError, TransportError
from swarm.listening import Handlers
from swarm.log import Logger
from swarm.messages import Beacon, Message, SceneDescription
from swarm.session import Session

MARGIN_M = 10.0
"""Robots are heard this far beyond where they count: two that drive towards each other at 2 m/s
take 2.5 s for it, five scene descriptions."""
KEEP_M = 8.0
"""So much farther a cell is kept, so that an ego that goes to and fro at a border does not listen
anew each time."""
STEP_M = 1.0
"""Shorter ways change nothing: the margin is wider."""
MAX_REACH_M = 150.0
"""A wider range touches more cells than listening to them would spare."""
AGAIN_S = 0.5
"""How soon it tries again where it could not listen: replacing a session takes longer."""

Wanted = tuple[type[Message], Cell]
OnInvalid = Callable[[str, CoAdaptError], object]
Listen = Callable[[type[Message], str], Callable[[], None]]


class Surroundings:
    """Listens to the cells around the ego, on a thread of its own."""

    def __init__(self, comm_range_m: float, area_half_m: float, log: Logger) -> None:
        """`comm_range_m`: how far from the ego a robot may take part. `area_half_m`: half the side
        of the square that counts."""
        self._scenes_m = comm_range_m + MARGIN_M
        self._beacons_m = max(comm_range_m, area_half_m) + MARGIN_M
        self._log = log
        self._moved = threading.Event()
        self._stop = threading.Event()
        self._place: tuple[float, float] | None = None
        self._held: dict[Wanted, Callable[[], None]] = {}

    @property
    def cells(self) -> frozenset[Wanted]:
        """What is listened to now: kind of message and cell."""
        return frozenset(self._held)

    def attach(
        self, session: Session, handlers: Handlers, on_invalid: OnInvalid | None = None
    ) -> None:
        """Listens from now on, around where the ego is said to be; `on_invalid` hears of messages
        that do not validate (`Session.subscribe`). Raises TransportError when the session is
        closed."""

        def listen(kind: type[Message], key: str) -> Callable[[], None]:
            return session.subscribe(key, kind, handlers[kind], on_invalid)

        for kind in handlers:
            listen(kind, _key(kind, session.swarm))
        work = threading.Thread(
            target=self._follow, args=(listen, session.swarm), name="surroundings", daemon=True
        )
        work.start()

    def moved(self, x: float, y: float) -> None:
        """Takes where the ego is, metres in the world frame; returns at once."""
        self._place = (x, y)
        self._moved.set()

    def close(self) -> None:
        """Listens to no other cells any more; those of now end with their session."""
        self._stop.set()
        self._moved.set()

    def _follow(self, listen: Listen, swarm: str) -> None:
        done = (math.inf, math.inf)
        while True:
            self._moved.wait()
            self._moved.clear()
            if self._stop.is_set():
                return
            place = self._place
            if place is None or math.dist(place, done) < STEP_M:
                continue
            try:
                self._listen(listen, swarm, *place)
                done = place
            except TransportError as error:
                self._log.debug("cells_not_heard", error=str(error)[:300])
                if self._stop.wait(AGAIN_S):
                    return
                self._moved.set()

    def _listen(self, listen: Listen, swarm: str, x: float, y: float) -> None:
        """Hears of all cells that are near, and only then of none that are far."""
        for kind, cell in sorted(self.around(x, y) - self._held.keys(), key=repr):
            key = keyspace.within(_key(kind, swarm), name_of(cell))
            self._held[kind, cell] = listen(kind, key)
        for far in self._held.keys() - self.around(x, y, KEEP_M):
            self._held.pop(far)()

    def around(self, x: float, y: float, more_m: float = 0.0) -> set[Wanted]:
        """The kinds of messages and cells that count, and those so much farther."""
        beacons = cells_of_square(x, y, self._beacons_m + more_m)
        scenes = cells_of_disc(x, y, self._scenes_m + more_m)
        return {(Beacon, cell) for cell in beacons} | {(SceneDescription, cell) for cell in scenes}


def _key(kind: type[Message], swarm: str) -> str:
    """Where robots tell that do not say in which cell they are."""
    key = keyspace.beacon if kind is Beacon else keyspace.scene
    return key(swarm, keyspace.ANY)
