"""What the API does: one method an operation, with decoded bodies in and answers out."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

from msgspec import UNSET

from network_controller.qod import problems, profiles
from network_controller.qod.book import Session, SessionBook
from network_controller.qod.destinations import Destinations
from network_controller.qod.devices import identified, link_of
from network_controller.qod.events import Notifier
from network_controller.qod.messages import (
    CreateSession,
    ExtendSessionDuration,
    QosProfile,
    QosProfileRequest,
    RetrieveSessionsInput,
    SessionInfo,
    StatusChange,
    StatusEvent,
)
from network_controller.qod.metrics import QodMetrics
from network_controller.qod.network import Network
from network_controller.qod.operations import SESSIONS
from swarm.http.openapi import Health
from swarm.log import Logger


class Service:
    """The sessions and profiles of one network."""

    def __init__(
        self, network: Network, destinations: Destinations, metrics: QodMetrics, log: Logger
    ) -> None:
        """See `SessionBook`."""
        self._network = network
        self._metrics = metrics
        self._events = Notifier(destinations, metrics, log)
        self.book = SessionBook(network, self._changed, destinations, log)
        self.operations: Mapping[str, Callable[[Mapping[str, str], Any], Any]] = {
            "createSession": self._create,
            "getSession": self._get,
            "deleteSession": self._delete,
            "extendQosSessionDuration": self._extend,
            "retrieveSessionsByDevice": self._retrieve,
            "retrieveQoSProfiles": self._retrieve_profiles,
            "listQosProfiles": lambda path, body: [profiles.profile(n) for n in profiles.LEVELS],
            "getQosProfile": self._get_profile,
            "getHealth": lambda path, body: Health(),
        }

    def start(self) -> None:
        """Begins to keep time and to send events."""
        self._events.start()
        self.book.start()

    def close(self) -> None:
        """Ends all sessions, and tells their sinks."""
        self.book.close()
        self._events.close()

    def _create(self, path: Mapping[str, str], body: CreateSession) -> SessionInfo:
        return self.book.create(body)

    def _get(self, path: Mapping[str, str], body: None) -> SessionInfo:
        return self.book.get(_session_id(path))

    def _delete(self, path: Mapping[str, str], body: None) -> None:
        self.book.delete(_session_id(path))

    def _extend(self, path: Mapping[str, str], body: ExtendSessionDuration) -> SessionInfo:
        return self.book.extend(_session_id(path), body.requested_additional_duration)

    def _retrieve(self, path: Mapping[str, str], body: RetrieveSessionsInput) -> list[SessionInfo]:
        return self.book.of_device(identified(body.device))

    def _retrieve_profiles(
        self, path: Mapping[str, str], body: QosProfileRequest
    ) -> list[QosProfile]:
        capacity_bps = None
        if body.device is not UNSET:
            _, capacity_bps = link_of(self._network, identified(body.device))
        offered = [profiles.profile(name, capacity_bps) for name in profiles.LEVELS]
        return [
            one
            for one in offered
            if body.name in (UNSET, one.name) and body.status in (UNSET, one.status)
        ]

    def _get_profile(self, path: Mapping[str, str], body: None) -> QosProfile:
        name = path["name"]
        if name not in profiles.LEVELS:
            raise problems.not_found(
                f"there is no profile {name!r}, only {', '.join(profiles.LEVELS)}"
            )
        return profiles.profile(name)

    def _changed(self, session: Session) -> None:
        gauge = self._metrics.sessions.labels(session.request.qos_profile)
        if session.status == "AVAILABLE":
            gauge.inc()
        elif session.started is not None:
            gauge.dec()
        if session.sink is None or session.status == "REQUESTED":
            return
        change = StatusChange(
            session_id=session.id,
            qos_status=session.status,
            status_info=session.info or UNSET,
        )
        event = StatusEvent(
            id=str(uuid.uuid4()),
            source=f"{SESSIONS}/{session.id}",
            time=datetime.now(UTC),
            data=change,
        )
        self._events.post(session.sink, event)


def _session_id(path: Mapping[str, str]) -> str:
    raw = path["sessionId"]
    try:
        parsed = str(uuid.UUID(raw))
    except ValueError:
        parsed = ""
    if parsed != raw.lower():
        raise problems.invalid("sessionId must be a UUID, as in the answer to createSession")
    return parsed
