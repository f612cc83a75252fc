"""Sends what an ego of a running swarm found as Collective Perception Messages over UDP."""

from __future__ import annotations

import queue
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from options.etsi.message import encode
from options.etsi.modules import compiled
from options.etsi.station import Station
from swarm.errors import MessageError, NetworkError
from swarm.listening import Handlers, listen
from swarm.messages import Beacon, Detections

AWAY_S = 8.0
"""The swarm's router may restart; longer than this it is gone."""
CONNECT_S = 5.0
LOOK_S = 0.5
MAX_WAITING = 100


@dataclass(slots=True)
class Sent:
    """What came of it."""

    messages: int = 0
    objects: int = 0
    bytes: int = 0
    left_out: int = 0
    """Frames that could not be told of."""
    fault: str = ""
    """Why the last one could not."""
    ended: str = ""


def send(
    router: str,
    swarm: str,
    ego: str,
    station: Station,
    to: tuple[str, int],
    stop: threading.Event,
    say: Callable[[str], object],
) -> Sent:
    """Sends until `stop` is set, or the swarm is gone; each message is one datagram.

    Raises SettingError as `modules.compiled` does, TransportError when the swarm's router does not
    answer, and NetworkError for a host that there is not.
    """
    compiled()
    sent = Sent()
    came: queue.SimpleQueue[Detections | Beacon] = queue.SimpleQueue()

    def take(message: Detections | Beacon) -> None:
        if isinstance(message, Detections) or message.robot == ego:
            if came.qsize() < MAX_WAITING:
                came.put(message)
            else:
                sent.left_out += 1

    try:
        family, _, _, _, address = socket.getaddrinfo(*to, type=socket.SOCK_DGRAM)[0]
    except OSError as error:
        raise NetworkError(f"host {to[0]!r} cannot be found: {error}") from error
    handlers: Handlers = {Detections: take, Beacon: take}
    with (
        socket.socket(family, socket.SOCK_DGRAM) as way,
        listen(router, swarm, handlers, ego, timeout_s=CONNECT_S) as session,
    ):
        say(f"sending {ego}'s objects to {to[0]}:{to[1]}")
        last: Beacon | None = None
        heard_s = time.monotonic()
        while not stop.is_set():
            if session.links():
                heard_s = time.monotonic()
            elif time.monotonic() - heard_s > AWAY_S:
                sent.ended = f"the swarm's router has been away for {AWAY_S:.0f} s"
                return sent
            try:
                message = came.get(timeout=LOOK_S)
            except queue.Empty:
                continue
            if isinstance(message, Beacon):
                last = message
            elif last is not None:
                _send(station, message, last, way, address, sent)
    sent.ended = "stopped"
    return sent


def _send(
    station: Station,
    found: Detections,
    ego: Beacon,
    way: socket.socket,
    address: tuple[object, ...],
    sent: Sent,
) -> None:
    try:
        message = station.message(found, ego.sensor_pose())
        if message is None:
            return
        raw = encode(message)
        way.sendto(raw, address)
    except (MessageError, OSError) as error:
        sent.left_out += 1
        sent.fault = str(error)
        return
    sent.messages += 1
    sent.objects += len(message.objects)
    sent.bytes += len(raw)
