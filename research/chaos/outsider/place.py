"""Where an outsider stands, and what it hears before it lies."""

from __future__ import annotations

import random
import threading
from dataclasses import dataclass
from queue import Empty, Queue

import zenoh

from swarm import keyspace, transport
from swarm.errors import TransportError
from swarm.messages import Beacon
from swarm.session import Session

CONNECT_S = 8.0
HEAR_S = 5.0
READY = "ready"


@dataclass(frozen=True, slots=True)
class Place:
    """An outsider's view of a swarm."""

    router: str
    swarm: str
    robots: tuple[str, ...]
    """The ego first."""
    target: str
    chance: random.Random
    stop: threading.Event
    """Set when the fault is over."""

    def ready(self) -> None:
        """Says that the attack is under way."""
        print(READY, flush=True)

    def session(self) -> Session:
        """A session as the swarm's own processes have it. Raises TransportError."""
        return Session(self.router, self.swarm, timeout_s=CONNECT_S, stop=self.stop)

    def raw(self) -> zenoh.Session:
        """A session that sends what it likes. Raises TransportError."""
        config = transport.client_config(self.router)
        return transport.open_zenoh(config, timeout_s=CONNECT_S, stop=self.stop)

    def beacon(self, session: Session) -> Beacon:
        """A true beacon of the target, or of any robot where there is none. Raises TransportError
        where none comes."""
        heard: Queue[Beacon] = Queue()
        key = keyspace.beacon(self.swarm, self.target or keyspace.ANY)
        session.subscribe(key, Beacon, heard.put)
        try:
            return heard.get(timeout=HEAR_S)
        except Empty:
            raise TransportError(
                f"no beacon of {self.target or 'anybody'} within {HEAR_S:.0f} s"
            ) from None
