"""Listening to the swarm: little always, everything only while somebody looks."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

from options.console.controls import CONTROLS, Control
from options.console.view import MAX_ROBOTS, View
from swarm import keyspace
from swarm.asking import Answer
from swarm.errors import TransportError
from swarm.listening import listen
from swarm.log import Logger
from swarm.messages import (
    Beacon,
    Decision,
    Detections,
    GatewayState,
    Message,
    NetDemand,
    NetState,
    RobotSteered,
    RobotSteering,
    SceneDescription,
    ShapeReply,
    ShapeRequest,
)
from swarm.session import Session
from swarm.traffic import TrafficClass

TICK_S = 0.5
LINGER_S = 5.0
"""How long the second session stays after the last viewer: a reload needs no new one."""
OPEN_S = 5.0
ANSWER_S = 15.0
STALLED_S = 2.0
"""A robot's process that does not answer so long stands still."""


class Watch:
    """Two sessions of the swarm on a thread of their own.

    The first one hears what comes once a cycle or less (decisions, demands, link states, who is
    alive), so that a page that is opened knows the last minutes. The second one hears beacons,
    scenes and detections, and is there only while `look` says that somebody looks.
    """

    def __init__(self, view: View, router: str, swarm: str, ego: str, log: Logger) -> None:
        self._view = view
        self._router = router
        self._swarm = swarm
        self._ego = ego
        self._log = log
        self._stop = threading.Event()
        self._changed = threading.Condition()
        self._viewers = 0
        self._poked = False
        self._left_at = 0.0
        self._left: deque[str] = deque(maxlen=MAX_ROBOTS)
        """Robots that left, to be asked why."""
        self._asked: set[str] = set()
        """Silent ones that are being asked whether they answer."""
        self._first: Session | None = None
        self._second: Session | None = None
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)
        self._thread.start()

    def look(self, viewers: int) -> None:
        """Tells how many look now. Returns at once."""
        with self._changed:
            if self._viewers and not viewers:
                self._left_at = time.monotonic()
            self._viewers = viewers
            self._poke()

    @property
    def looking(self) -> bool:
        """Whether beacons, scenes and detections are listened to."""
        return self._second is not None

    def ask_controllers(self, request: ShapeRequest) -> Mapping[str, Future[Answer[ShapeReply]]]:
        """Asks each network controller that has to do with it; see `ask`. Raises NetworkError, too:
        where none has the link."""
        requests = self._view.addressees(request)
        return {name: self.ask(CONTROLS["shape"], one, name) for name, one in requests.items()}

    def ask(self, control: Control, request: Message, who: str = "") -> Future[Answer[Any]]:
        """Asks who answers such requests, the robot or the network controller of that name; see
        `Session.ask`.

        Raises TransportError while the swarm cannot be reached, KeyspaceError for a name that is
        none.
        """
        session = self._first
        if session is None or not session.links():
            raise TransportError(f"the router of swarm {self._swarm!r} cannot be reached")
        key = control.key(self._swarm, self._view.ego, who)
        return session.ask(
            key, request, control.reply, timeout_s=ANSWER_S, traffic=TrafficClass.CONTROL
        )

    def close(self) -> None:
        """Ends both sessions."""
        self._stop.set()
        with self._changed:
            self._poke()
        self._thread.join(2 * OPEN_S)

    def _run(self) -> None:
        first = self._first = self._open_first()
        while first is not None and not self._stop.is_set():
            connected = first.links() > 0
            # Before another session is opened, which may take seconds.
            self._view.tick(connected)
            self._open_or_close(connected)
            while self._left:
                self._ask_why(self._left.popleft())
            for robot in self._view.silent():
                self._ask_whether(robot)
            with self._changed:
                self._changed.wait_for(lambda: self._poked, TICK_S)
                self._poked = False
        for session in (self._second, first):
            if session is not None:
                session.close()

    def _poke(self) -> None:
        self._poked = True
        self._changed.notify()

    def _wanted(self) -> bool:
        return self._viewers > 0 or (self.looking and time.monotonic() - self._left_at < LINGER_S)

    def _open_first(self) -> Session | None:
        """The first session, once the router is there; None when told to stop before."""
        while not self._stop.is_set():
            try:
                return self._open_rare()
            except TransportError as error:
                self._log.debug("not_listening", error=str(error)[:300])
                self._stop.wait(TICK_S)
        return None

    def _open_or_close(self, connected: bool) -> None:
        wanted = self._wanted()
        if wanted and self._second is None and connected:
            try:
                self._second = self._open_all()
            except TransportError:
                return  # The router went away just now: again at the next turn.
            self._view.sees()
            self._log.info("looking")
        elif not wanted and self._second is not None:
            self._second.close()
            self._second = None
            self._view.blind()
            self._log.info("not_looking")

    def _ask_why(self, robot: str) -> None:
        """Whether a robot that left was taken off duty; one that is lost does not answer."""

        def answered(future: Future[Answer[RobotSteered]]) -> None:
            if future.exception() is None:
                self._view.on_duty(future.result().message)

        with suppress(TransportError):
            self.ask(CONTROLS["robot"], RobotSteering(duty="ask"), robot).add_done_callback(
                answered
            )

    def _ask_whether(self, robot: str) -> None:
        """Whether a robot that is alive but not heard answers."""
        session = self._first
        if session is None or robot in self._asked:
            return
        self._asked.add(robot)

        def answered(future: Future[Answer[RobotSteered]]) -> None:
            self._view.on_answer(robot, future.exception() is None)
            self._asked.discard(robot)

        session.ask(
            keyspace.robot_steering(self._swarm, robot),
            RobotSteering(duty="ask"),
            RobotSteered,
            timeout_s=STALLED_S,
            traffic=TrafficClass.CONTROL,
        ).add_done_callback(answered)

    def _on_leave(self, robot: str) -> None:
        self._view.on_leave(robot)
        self._left.append(robot)

    def _open_rare(self) -> Session:
        """Raises TransportError where it was lost at once."""
        view = self._view
        return listen(
            self._router,
            self._swarm,
            {
                Decision: view.on_decision,
                GatewayState: view.on_gateway_state,
                NetDemand: view.on_demand,
                NetState: view.on_net_state,
            },
            self._ego,
            on_join=view.on_join,
            on_leave=self._on_leave,
            on_gateway=view.on_gateway,
            log=self._log,
            stop=self._stop,
        )

    def _open_all(self) -> Session:
        """Raises TransportError where the router is not there."""
        view = self._view
        return listen(
            self._router,
            self._swarm,
            {
                Beacon: view.on_beacon,
                SceneDescription: view.on_scene,
                Detections: view.on_detections,
            },
            self._ego,
            timeout_s=OPEN_S,
            log=self._log,
            stop=self._stop,
        )
