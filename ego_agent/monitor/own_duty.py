"""Whether operators have taken the ego's own robot off duty.

The robot's process tells when it is asked. The ego asks only while the robot's liveliness token is
away: where nobody answers there is no such process, and the ego goes on with its own sensor.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future

from swarm import keyspace
from swarm.errors import CoAdaptError
from swarm.messages import RobotSteered, RobotSteering
from swarm.session import Answer, Session
from swarm.traffic import TrafficClass

ASK_S = 1.0
"""How often a robot that is away is asked, and how long its answer may take."""
MAX_ASK_S = 10.0
"""How rarely where nobody answers."""


class OwnDuty:
    """Watches one robot; `look` belongs to the control cycle and never waits."""

    def __init__(self, robot: str, tell: Callable[[str], None]) -> None:
        """`tell` hears who keeps the robot off duty, empty where nobody does; it may be called on
        any thread."""
        self._robot = robot
        self._tell = tell
        self._there = False
        self._due = 0.0
        self._pause_s = ASK_S

    def attach(self, session: Session) -> None:
        """Watches the robot's token from now on."""
        session.watch_alive(self._joined, self._left, self._robot)

    def look(self, session: Session | None) -> None:
        """Asks the robot again when that is due."""
        now = time.monotonic()
        if session is None or self._there or now < self._due:
            return
        self._due = now + self._pause_s
        session.ask(
            keyspace.robot_steering(session.swarm, self._robot),
            RobotSteering(duty="ask"),
            RobotSteered,
            timeout_s=ASK_S,
            traffic=TrafficClass.CONTROL,
        ).add_done_callback(self._answered)

    def _joined(self, robot: str) -> None:
        if robot == self._robot:
            self._there = True
            self._tell("")

    def _left(self, robot: str) -> None:
        if robot == self._robot:
            self._there, self._due, self._pause_s = False, 0.0, ASK_S

    def _answered(self, future: Future[Answer[RobotSteered]]) -> None:
        error = future.exception()
        if isinstance(error, CoAdaptError):
            self._pause_s = min(2.0 * self._pause_s, MAX_ASK_S)
            return
        reply = future.result().message
        self._pause_s = ASK_S
        if not self._there:
            self._tell("" if reply.on_duty else reply.operator or "an operator")
