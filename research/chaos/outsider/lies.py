"""Messages in another's name."""

from __future__ import annotations

import time
from contextlib import suppress

import msgspec
import zenoh

from research.chaos.outsider.place import Place
from swarm import keyspace, transport
from swarm.errors import RefusedError
from swarm.messages import Beacon, Observation, ObservationRequest
from swarm.session import Session

PERIOD_S = 0.1
AHEAD = 1 << 40
FOREIGN_BYTES = 4_999
"""Size of an impostor's payloads."""


def _say(place: Place, session: Session, beacon: Beacon) -> None:
    session.put(keyspace.beacon(place.swarm, place.target), beacon)


def fake(place: Place) -> str:
    """Beacons of a process of its own in the target's name, from somewhere else, and its token."""
    said = 0
    with place.session() as session:
        beacon = place.beacon(session)
        session.declare_alive(place.target)
        instance = place.chance.getrandbits(48)
        while not place.stop.wait(PERIOD_S):
            said += 1
            _say(
                place,
                session,
                msgspec.structs.replace(
                    beacon,
                    instance=instance,
                    seq=said,
                    sent_ns=time.time_ns(),
                    capture_ns=time.time_ns(),
                    pose=(0.0, 0.0, *beacon.pose[2:]),
                ),
            )
    return f"{said} beacons of another {place.target}"


def ahead(place: Place) -> str:
    """Copies of the target's own instance with numbers far ahead."""
    said = 0
    with place.session() as session:
        beacon = place.beacon(session)
        while not place.stop.wait(PERIOD_S):
            said += 1
            _say(place, session, msgspec.structs.replace(beacon, seq=AHEAD + said))
    return f"{said} copies of {place.target}'s beacon, numbered from 2^40"


def impostor(place: Place) -> str:
    """Answers in the target's place, once the target is started again."""
    answered = 0
    instance = place.chance.getrandbits(48)

    def answer(request: ObservationRequest) -> Observation:
        nonlocal answered
        if place.stop.is_set():
            raise RefusedError("over")
        answered += 1
        return Observation(
            robot=place.target,
            instance=instance,
            request=request.request,
            algorithm=request.algorithm,
            capture_ns=request.capture_ns or time.time_ns(),
            frame=0,
            pose=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            payload=place.chance.randbytes(FOREIGN_BYTES),
            encode_ms=1.0,
        )

    with place.session() as session:
        key = keyspace.observation(place.swarm, place.target)
        session.serve(key, ObservationRequest, answer)
        place.ready()
        place.stop.wait()
    return f"{answered} answers in the name of {place.target}"


def withdraw(place: Place) -> str:
    """Serves the target's key and withdraws it before it leaves, as an orderly process might."""
    session = place.raw()
    key = keyspace.observation(place.swarm, place.target)
    queryable = session.declare_queryable(key, _drop, complete=True)
    place.ready()
    place.stop.wait()
    with suppress(zenoh.ZError):
        queryable.undeclare()  # type: ignore[no-untyped-call]
    transport.close_zenoh(session)
    return f"a queryable of {place.target} came and was withdrawn"


def _drop(query: zenoh.Query) -> None:
    with query:
        pass


ATTACKS = {
    "fake-beacon": fake,
    "numbers-ahead": ahead,
    "impostor": impostor,
    "withdrawn-server": withdraw,
}
