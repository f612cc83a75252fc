"""Where an outsider stands, and what it hears before it lies."""

from __future__ import annotations

import random
import threading
import time
from dataclasses import dataclass, field
from queue import Empty, Queue

import zenoh

from swarm import keyspace, transport, zenoh_config
from swarm.messages import Beacon
from swarm.session import Session

CONNECT_S = 8.0
HEAR_S = 2.0
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

    admitted: list[float] = field(default_factory=list)
    """When the router took each of its sessions, seconds since the Unix epoch."""

    def ready(self) -> None:
        """Says that the attack is under way."""
        print(READY, flush=True)

    def session(self) -> Session:
        """A session as the swarm's own processes have it. Raises TransportError."""
        session = Session(self.router, self.swarm, timeout_s=CONNECT_S, stop=self.stop)
        self.admitted.append(time.time())
        return session

    def raw(self) -> zenoh.Session:
        """A session that sends what it likes. Raises TransportError."""
        config = zenoh_config.client_config(self.router)
        session = transport.open_zenoh(config, timeout_s=CONNECT_S, stop=self.stop)
        self.admitted.append(time.time())
        return session

    def beacon(self, session: Session) -> Beacon:
        """A true beacon of the target, or of any robot where there is none; one that is made up
        where none is to be heard."""
        heard: Queue[Beacon] = Queue()
        key = keyspace.beacon(self.swarm, self.target or keyspace.ANY)
        session.subscribe(key, Beacon, heard.put)
        try:
            return heard.get(timeout=HEAR_S)
        except Empty:
            return Beacon(
                robot=self.target or self.robots[-1],
                instance=self.chance.getrandbits(48),
                seq=0,
                sent_ns=time.time_ns(),
                capture_ns=time.time_ns(),
                frame=0,
                pose=(0.0,) * 6,
                velocity=(0.0,) * 3,
                range_m=25.0,
                sizes={"early": 10_000, "late": 500},
            )
