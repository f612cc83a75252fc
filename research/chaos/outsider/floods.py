"""Too much, too large, too long, or nonsense."""

from __future__ import annotations

import itertools
import socket
from contextlib import ExitStack, suppress

import zenoh

from research.chaos.outsider.place import Place
from swarm import keyspace, transport
from swarm.errors import TransportError
from swarm.messages import ObservationRequest

HUGE_BYTES = 300_000_000
HOUR_S = 3600.0
QUERIES = 64
PERIOD_S = 0.05
SILENT = 40


def huge(place: Place) -> str:
    """One message of 300 MB on a beacon's key."""
    session = place.raw()
    with suppress(zenoh.ZError):
        session.put(keyspace.beacon(place.swarm, place.target), bytes(HUGE_BYTES))
    place.stop.wait()
    transport.close_zenoh(session)
    return f"{HUGE_BYTES} bytes in one message"


def wait(place: Place) -> str:
    """Questions to the target, as many as it has places, whose asker waits for an hour."""
    with place.session() as session:
        key = keyspace.observation(place.swarm, place.target)
        for number in range(QUERIES):
            if place.stop.is_set():
                break
            request = ObservationRequest(
                ego=f"Z{number % 8}", request=number, algorithm="early", capture_ns=0
            )
            session.ask(key, request, ObservationRequest, timeout_s=HOUR_S)
            place.stop.wait(PERIOD_S)
        place.stop.wait()
    return f"{number + 1} questions that wait for an hour"


def garbage(place: Place) -> str:
    """Random bytes on every key of the swarm, also through wildcards."""
    ego = place.robots[0]
    keys = [
        *(keyspace.beacon(place.swarm, robot) for robot in place.robots),
        *(keyspace.scene(place.swarm, robot) for robot in place.robots),
        keyspace.decision(place.swarm, ego),
        keyspace.detections(place.swarm, ego),
        keyspace.net_state(place.swarm),
        keyspace.net_tcp(place.swarm),
        keyspace.net_demand(place.swarm),
        keyspace.llm_state(place.swarm),
    ]
    return _scatter(place, keys)


def wildcards(place: Place) -> str:
    """Puts on key expressions that match what everybody listens to."""
    swarm = place.swarm
    return _scatter(place, [f"coadapt/{swarm}/**", f"coadapt/{swarm}/robot/*/beacon", "**"])


def _scatter(place: Place, keys: list[str]) -> str:
    session = place.raw()
    said = 0
    for key in itertools.cycle(keys):
        if place.stop.wait(PERIOD_S / 5):
            break
        # The router may have closed the connection.
        with suppress(zenoh.ZError):
            session.put(key, place.chance.randbytes(place.chance.randrange(2_000)))
            said += 1
    transport.close_zenoh(session)
    return f"{said} random messages"


def silent(place: Place) -> str:
    """Connections to the router's ports that never say a word, or half a sentence."""
    host, port = place.router.partition("/")[2].partition("#")[0].rsplit(":", 1)
    with ExitStack() as stack:
        for number in range(SILENT):
            try:
                one = socket.create_connection((host, int(port) + number % 3), timeout=2.0)
            except OSError as error:
                raise TransportError(f"connection {number} was refused: {error}") from error
            stack.enter_context(one)
            if number % 2:
                one.sendall(place.chance.randbytes(7))
        place.stop.wait()
    return f"{SILENT} connections that say nothing"


ATTACKS = {
    "huge-message": huge,
    "waiting-queries": wait,
    "garbage": garbage,
    "wildcard-puts": wildcards,
    "silent-connections": silent,
}
