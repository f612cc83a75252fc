"""The sessions: who holds which level on whose link, and until when.

Sessions live in memory. When the controller ends they end, and the controller drops its holds.
"""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from msgspec import UNSET

from network_controller.qod import problems
from network_controller.qod.destinations import Destinations
from network_controller.qod.devices import find, identified, link_of
from network_controller.qod.flows import overlap
from network_controller.qod.messages import (
    CreateSession,
    Device,
    QosStatus,
    SessionInfo,
    StatusInfo,
)
from network_controller.qod.network import Network
from network_controller.qod.profiles import LEVELS, MAX_DURATION_S, MIN_DURATION_S
from network_controller.qod.sinks import Sink, sink_of
from swarm.errors import NetworkError
from swarm.log import Logger

RETRY_S = 1.0
KEEP_S = 360.0
"""How long a session that has ended can still be read; CAMARA asks for this at least."""
MAX_SESSIONS = 1000


@dataclass(slots=True)
class Session:
    """One session; the lock of its book protects it."""

    id: str
    request: CreateSession
    device: Device
    robot: str
    sink: Sink | None
    duration_s: int
    status: QosStatus = "REQUESTED"
    info: StatusInfo | None = None
    started: datetime | None = None
    ends: datetime | None = None
    due_s: float = 0.0
    """Monotonic: when it expires, or when it is forgotten after its end."""

    def show(self) -> SessionInfo:
        """What clients get; never the sink's credential."""
        request = self.request
        return SessionInfo(
            device=self.device,
            application_server=request.application_server,
            device_ports=request.device_ports,
            application_server_ports=request.application_server_ports,
            qos_profile=request.qos_profile,
            sink=request.sink,
            session_id=self.id,
            duration=self.duration_s,
            started_at=self.started or UNSET,
            expires_at=self.ends or UNSET,
            qos_status=self.status,
            status_info=self.info or UNSET,
        )


class SessionBook:
    """All sessions. `on_change` hears of every change of status, under the book's lock, and must
    not wait. One thread ends what is due."""

    def __init__(
        self,
        network: Network,
        on_change: Callable[[Session], None],
        destinations: Destinations,
        log: Logger,
        *,
        keep_s: float = KEEP_S,
    ) -> None:
        """`destinations`: where sinks may be."""
        self._network = network
        self._on_change = on_change
        self._log = log
        self._destinations = destinations
        self._keep_s = keep_s
        self._sessions: dict[str, Session] = {}
        self._changed = threading.Condition(threading.RLock())
        self._closed = False
        self._timer = threading.Thread(target=self._keep_time, name="qod-timer", daemon=True)

    def start(self) -> None:
        """Begins to end sessions in time."""
        self._timer.start()

    def create(self, request: CreateSession) -> SessionInfo:
        """A new session, AVAILABLE once the kernel has confirmed it, or UNAVAILABLE when it could
        not. Raises Problem, and NetworkError when the network cannot be asked."""
        if request.qos_profile not in LEVELS:
            raise problems.invalid(
                f"qosProfile {request.qos_profile!r} must be one of {', '.join(LEVELS)}"
            )
        if not MIN_DURATION_S <= request.duration <= MAX_DURATION_S:
            raise problems.out_of_range(
                f"duration {request.duration} must be from {MIN_DURATION_S} to {MAX_DURATION_S} s "
                f"with {request.qos_profile}"
            )
        sink = sink_of(request, self._destinations)
        device = identified(request.device)
        with self._changed:
            robot, _ = link_of(self._network, device)
            for other in self._sessions.values():
                # One that the network ended stands in the way until it is deleted, says CAMARA.
                if (
                    other.robot == robot
                    and other.info != "DURATION_EXPIRED"
                    and overlap(other.request, request)
                ):
                    raise problems.conflict(
                        f"session {other.id}, which is {other.status}, is for the same device and "
                        "overlapping flows; delete it first"
                    )
            if self._closed or len(self._sessions) >= MAX_SESSIONS:
                raise problems.too_many(f"there are {MAX_SESSIONS} sessions; delete some first")
            session = Session(str(uuid.uuid4()), request, device, robot, sink, request.duration)
            self._sessions[session.id] = session
            try:
                self._network.hold(session.id, robot, LEVELS[request.qos_profile])
            except NetworkError as error:
                self._log.warning("qod_session_failed", session=session.id, error=str(error))
                self._end(session, "NETWORK_TERMINATED")
            else:
                self._begin(session)
            return session.show()

    def get(self, session_id: str) -> SessionInfo:
        """A session, also one that ended a short while ago. Raises Problem."""
        with self._changed:
            return self._find(session_id).show()

    def delete(self, session_id: str) -> None:
        """Ends and forgets a session. Raises Problem when there is none."""
        with self._changed:
            session = self._find(session_id)
            if session.status == "AVAILABLE":
                self._end(session, "DELETE_REQUESTED")
            del self._sessions[session.id]

    def extend(self, session_id: str, seconds: int) -> SessionInfo:
        """A session with more time, as far as its profile allows. Raises Problem."""
        with self._changed:
            session = self._find(session_id)
            if session.status != "AVAILABLE" or session.ends is None:
                raise problems.not_extendable(session.status)
            granted_s = min(session.duration_s + seconds, MAX_DURATION_S) - session.duration_s
            session.duration_s += granted_s
            session.ends += timedelta(seconds=granted_s)
            session.due_s += granted_s
            self._changed.notify_all()
            self._log.info("qod_session_extended", session=session.id, seconds=granted_s)
            return session.show()

    def of_device(self, device: Device) -> list[SessionInfo]:
        """A device's sessions; a robot that is gone is still known by those it had.

        Raises Problem for an unknown device.
        """
        device = identified(device)
        with self._changed:
            robot = find(self._network, device)
            found = [
                session.show()
                for session in self._sessions.values()
                if session.robot == robot or session.device == device
            ]
        if robot is None and not found:
            raise problems.unknown_device("nobody in this swarm has the device's address")
        return found

    def lost(self, robot: str) -> None:
        """Ends the sessions of a robot whose link is gone or not shaped any more.

        The caller must not keep the network's own lock: this calls the network.
        """
        with self._changed:
            for session in self._sessions.values():
                if session.robot == robot and session.status == "AVAILABLE":
                    self._end(session, "NETWORK_TERMINATED")

    def close(self) -> None:
        """Ends all sessions."""
        with self._changed:
            self._closed = True
            for session in self._sessions.values():
                if session.status == "AVAILABLE":
                    self._end(session, "NETWORK_TERMINATED")
            self._changed.notify_all()
        if self._timer.is_alive():
            self._timer.join()

    def _find(self, session_id: str) -> Session:
        try:
            return self._sessions[session_id]
        except KeyError:
            raise problems.not_found(f"there is no session {session_id}") from None

    def _begin(self, session: Session) -> None:
        session.status = "AVAILABLE"
        session.started = datetime.now(UTC)
        session.ends = session.started + timedelta(seconds=session.duration_s)
        # Not by the clock on the wall, which may be set.
        session.due_s = time.monotonic() + session.duration_s
        self._tell(session)

    def _end(self, session: Session, why: StatusInfo) -> None:
        try:
            self._network.release(session.id)
        except NetworkError as error:
            self._log.error("qod_release_failed", session=session.id, error=str(error))
        session.status, session.info = "UNAVAILABLE", why
        session.ends = datetime.now(UTC)
        lasted = session.ends - session.started if session.started else timedelta(0)
        session.duration_s = max(1, round(lasted.total_seconds()))
        session.due_s = time.monotonic() + self._keep_s
        self._tell(session)

    def _tell(self, session: Session) -> None:
        self._log.info(
            "qod_session",
            session=session.id,
            robot=session.robot,
            profile=session.request.qos_profile,
            status=session.status,
            why=session.info,
        )
        self._on_change(session)
        self._changed.notify_all()

    def _keep_time(self) -> None:
        with self._changed:
            while not self._closed:
                try:
                    self._end_what_is_due()
                except Exception:
                    # Without this thread no session would ever end.
                    self._log.error("qod_step_failed", exc_info=True)
                    self._changed.wait(RETRY_S)
                    continue
                due_s = min((s.due_s for s in self._sessions.values()), default=None)
                self._changed.wait(None if due_s is None else max(0.0, due_s - time.monotonic()))

    def _end_what_is_due(self) -> None:
        now_s = time.monotonic()
        for session in [s for s in self._sessions.values() if s.due_s <= now_s]:
            if session.status == "AVAILABLE":
                self._end(session, "DURATION_EXPIRED")
            else:
                del self._sessions[session.id]
