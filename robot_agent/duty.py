"""Whether a robot is part of the swarm, and what operators say about that."""

from __future__ import annotations

import threading
from collections.abc import Callable

import msgspec

from robot_agent.agent import RobotAgent
from robot_agent.metrics import RobotMetrics
from swarm import keyspace
from swarm.errors import DutyError
from swarm.log import Logger
from swarm.messages import Backlog, Observation, ObservationRequest, RobotSteered, RobotSteering
from swarm.session import Session

OBSERVE_WORKERS = 3
"""Two for an ego whose frames overlap, and one that is left for the others."""


class Duty:
    """One robot's duty. Off duty it is alive for nobody and answers nothing but steering."""

    def __init__(
        self,
        agent: RobotAgent,
        session: Session,
        metrics: RobotMetrics,
        log: Logger,
        uplink: Callable[[], Backlog],
    ) -> None:
        """Serves the robot's queries and shows it as alive. `uplink()` is how the connection
        upwards does."""
        self.on = True
        """Read by the robot's loops."""
        self._agent = agent
        self._session = session
        self._log = log
        self._uplink = uplink
        self._shown = metrics.on_duty.labels(agent.robot)
        self._shown.set(1)
        self._lock = threading.Lock()
        self._operator = ""
        self._since_ns = 0
        swarm, robot = session.swarm, agent.robot
        session.serve(
            keyspace.observation(swarm, robot),
            ObservationRequest,
            self._observe,
            workers=OBSERVE_WORKERS,
            newest_first=True,
        )
        session.serve(keyspace.robot_steering(swarm, robot), RobotSteering, self._steer, workers=1)
        # The token comes last: who sees it may ask at once.
        self._withdraw: Callable[[], None] = session.declare_alive(robot)

    def _observe(self, request: ObservationRequest) -> Observation:
        if not self.on:
            raise DutyError(f"robot {self._agent.robot} is off duty (by {self._operator})")
        return msgspec.structs.replace(self._agent.observe(request), uplink=self._uplink())

    def _steer(self, request: RobotSteering) -> RobotSteered:
        with self._lock:
            if request.duty != "ask" and (request.duty == "on") != self.on:
                self._change(request.duty == "on", request.operator)
            return RobotSteered(
                request=request.request,
                robot=self._agent.robot,
                on_duty=self.on,
                operator=self._operator,
                since_ns=self._since_ns,
            )

    def _change(self, on: bool, operator: str) -> None:
        self._operator, self._since_ns = operator or "unknown", self._agent.now_ns()
        if on:
            # What it saw before is too old to tell anybody.
            self._agent.rest()
            self.on = True
            self._withdraw = self._session.declare_alive(self._agent.robot)
        else:
            self.on = False
            self._withdraw()
        self._shown.set(on)
        self._log.info("duty", robot=self._agent.robot, on=on, operator=self._operator)
