"""Tells ROS 2 what an ego of a running swarm found, until somebody ends it."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from options.ros.fused import Said, Teller
from options.ros2.output import Output, Target
from swarm.errors import MessageError, TransportError
from swarm.listening import Handlers, listen
from swarm.messages import Detections, SceneDescription

AWAY_S = 8.0
"""The swarm's router may restart; longer than this it is gone."""
CONNECT_S = 5.0
MAX_WAITING = 200
"""Messages; a slow network of ROS gets newer ones in place of more."""
LOOK_S = 0.5


@dataclass(slots=True)
class Told:
    """What came of it."""

    messages: int = 0
    lost: int = 0
    """Messages of the swarm that found too many waiting, or could not be used."""
    ended: str = ""
    """Why it ended."""


def tell(
    router: str,
    swarm: str,
    ego: str,
    target: Target,
    stop: threading.Event,
    say: Callable[[str], object],
) -> Told:
    """Publishes what is said of one ego until `stop` is set, or the swarm is gone.

    Args:
        router: the swarm's.
        swarm: its name.
        ego: whose detections.
        target: where ROS is.
        stop: ends it when it is set.
        say: is given lines of progress.

    Raises TransportError when the swarm's router does not answer, and for a router of ROS that
    cannot be used.
    """
    told = Told()
    came: queue.SimpleQueue[Detections | SceneDescription] = queue.SimpleQueue()

    def take(message: Detections | SceneDescription) -> None:
        if came.qsize() < MAX_WAITING:
            came.put(message)
        else:
            told.lost += 1

    try:
        output = Output(target, node_name(swarm, ego), stop, say)
    except TransportError:
        if not stop.is_set():
            raise
        told.ended = f"no router of ROS was reached at {target.router}"
        return told
    except zenoh.ZError as error:
        raise TransportError(
            f"the router of ROS at {target.router} cannot be used: {error}"
        ) from error
    handlers: Handlers = {Detections: take, SceneDescription: take}
    with output, listen(router, swarm, handlers, ego, timeout_s=CONNECT_S) as session:
        say(f"publishing {ego}'s objects in domain {target.domain} at {target.router}")
        told.ended = _forward(came, Teller(ego), output, told, stop, session.links)
    return told


def _forward(
    came: queue.SimpleQueue[Detections | SceneDescription],
    teller: Teller,
    output: Output,
    told: Told,
    stop: threading.Event,
    links: Callable[[], object],
) -> str:
    """Why it ended."""
    heard_s = time.monotonic()
    while not stop.is_set():
        if links():
            heard_s = time.monotonic()
        elif time.monotonic() - heard_s > AWAY_S:
            return f"the swarm's router has been away for {AWAY_S:.0f} s"
        try:
            said = _said(teller, came.get(timeout=LOOK_S))
        except queue.Empty:
            continue
        except MessageError:
            told.lost += 1
            continue
        for one in said:
            output.put(one)
            told.messages += 1
    return "stopped"


def _said(teller: Teller, message: Detections | SceneDescription) -> tuple[Said, ...]:
    if isinstance(message, Detections):
        return teller.on_detections(message)
    return teller.on_scene(message, time.monotonic_ns())


def node_name(swarm: str, ego: str) -> str:
    """What `ros2 node list` calls it."""
    return f"coadapt_{swarm}_{ego}".replace("-", "_")
