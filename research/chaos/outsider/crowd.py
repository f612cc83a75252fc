"""Many robots that come and go, and names of robots that are not there."""

from __future__ import annotations

import time

import msgspec

from research.chaos.outsider.place import Place
from swarm import keyspace

CROWD = 100
FAR_M = 5_000.0
TOKENS = 255
PAUSE_S = 0.5


def join(place: Place) -> str:
    """A hundred light robots, too far away to take part, join in bursts and leave again."""
    rounds = 0
    with place.session() as session:
        model = place.beacon(session)
        while not place.stop.is_set():
            names = [f"X{place.chance.randrange(1_000)}" for _ in range(CROWD)]
            leave = [session.declare_alive(name) for name in dict.fromkeys(names)]
            for number, name in enumerate(dict.fromkeys(names)):
                beacon = msgspec.structs.replace(
                    model,
                    robot=name,
                    instance=place.chance.getrandbits(48),
                    seq=0,
                    sent_ns=time.time_ns(),
                    capture_ns=time.time_ns(),
                    pose=(FAR_M + number, FAR_M, *model.pose[2:]),
                )
                session.put(keyspace.beacon(place.swarm, name), beacon)
            place.stop.wait(PAUSE_S * place.chance.uniform(0.5, 2.0))
            for one in leave:
                one()
            rounds += 1
    return f"{rounds} times {CROWD} robots came and went"


def tokens(place: Place) -> str:
    """Tokens of robots that do not exist."""
    with place.session() as session:
        for number in range(TOKENS):
            session.declare_alive(f"Y{number}")
        place.stop.wait()
    return f"{TOKENS} tokens without a robot"


ATTACKS = {"join-leave": join, "fake-tokens": tokens}
