"""Listening to what a swarm publishes, by the type of message."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

from swarm import keyspace
from swarm.errors import CoAdaptError
from swarm.log import Logger
from swarm.messages import (
    Beacon,
    Decision,
    Detections,
    GatewayState,
    Message,
    NetDemand,
    NetState,
    SceneDescription,
    TcpState,
)
from swarm.session import Session

Handlers = Mapping[type[Message], Callable[[Any], object]]
"""Who hears of the messages of a type, on Zenoh's threads."""

_KEYS: dict[type[Message], Callable[[str, str], str]] = {
    Beacon: lambda swarm, ego: keyspace.anywhere(keyspace.beacon(swarm, keyspace.ANY)),
    SceneDescription: lambda swarm, ego: keyspace.anywhere(keyspace.scene(swarm, keyspace.ANY)),
    Decision: keyspace.decision,
    Detections: keyspace.detections,
    GatewayState: lambda swarm, ego: keyspace.llm_state(swarm),
    NetDemand: lambda swarm, ego: keyspace.net_demand(swarm),
    NetState: lambda swarm, ego: keyspace.net_state(swarm, keyspace.ANY),
    TcpState: lambda swarm, ego: keyspace.net_tcp(swarm),
}


def hear(
    session: Session,
    handlers: Handlers,
    ego: str = keyspace.ANY,
    *,
    on_invalid: Callable[[str, CoAdaptError], object] | None = None,
) -> None:
    """Hands over what comes from now on: of one ego or all, of all robots and the network. Of one
    ego is also what another says while it stands in for it.

    A message that does not validate is dropped, and logged once a sender; `on_invalid` hears of it
    (`Session.subscribe`).
    """
    if ego != keyspace.ANY and handlers.keys() & _OF_EGOS:
        handlers = _Led(ego).handlers(handlers)
        ego = keyspace.ANY
    for kind, handler in handlers.items():
        session.subscribe(_KEYS[kind](session.swarm, ego), kind, handler, on_invalid)


_OF_EGOS: set[type[Message]] = {Decision, Detections}


class _Led:
    """What is said by one ego, or in its stead: decisions tell who leads, detections follow."""

    def __init__(self, ego: str) -> None:
        self._ego = ego
        self._leads = ego

    def handlers(self, handlers: Handlers) -> Handlers:
        """Those that hear only of the ego that leads."""
        decision = handlers.get(Decision, lambda message: None)
        detections = handlers.get(Detections, lambda message: None)

        def on_decision(message: Decision) -> None:
            if self._ego in (message.ego, message.stands_in_for):
                self._leads = message.ego
                decision(message)

        def on_detections(message: Detections) -> None:
            if message.ego == self._leads:
                detections(message)

        led: dict[type[Message], Callable[[Any], object]] = {Decision: on_decision}
        if Detections in handlers:
            led[Detections] = on_detections
        return {**handlers, **led}


def listen(
    router: str,
    swarm: str,
    handlers: Handlers,
    ego: str = keyspace.ANY,
    *,
    on_join: Callable[[str], None] | None = None,
    on_leave: Callable[[str], None] | None = None,
    on_gateway: Callable[[bool], None] | None = None,
    timeout_s: float | None = None,
    log: Logger | None = None,
    stop: threading.Event | None = None,
) -> Session:
    """A session of its own that hears these messages, and of robots and gateways that come and go.

    Raises TransportError when the router cannot be reached in time, or is lost at once.
    """
    session = Session(router, swarm, log=log, timeout_s=timeout_s, stop=stop)
    try:
        if on_join is not None and on_leave is not None:
            session.watch_alive(on_join, on_leave)
        if on_gateway is not None:
            session.watch_gateway(on_gateway)
        hear(session, handlers, ego)
    except BaseException:
        session.close()
        raise
    return session
