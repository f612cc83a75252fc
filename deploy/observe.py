"""Listens to a running swarm for `coadapt status` and who else wants to see it from outside."""

from __future__ import annotations

import threading
import time
from concurrent.futures import wait

from deploy.latest_state import LatestState
from deploy.state import State
from deploy.view import SwarmView
from swarm import keyspace
from swarm.errors import TransportError
from swarm.listening import hear, listen
from swarm.messages import (
    Beacon,
    Decision,
    Detections,
    GatewayState,
    LinkState,
    NetState,
    RobotSteered,
    RobotSteering,
    ShapeReply,
    ShapeRequest,
)
from swarm.traffic import TrafficClass

CONNECT_S = 5.0
DUTY_S = 0.7
"""How long a robot that is not heard has to say whether it is on duty."""


class Watch:
    """Listens to one swarm through its router. Use as a context manager."""

    def __init__(self, state: State, timeout_s: float = CONNECT_S) -> None:
        """Raises TransportError when the router cannot be reached in time."""
        self._state = state
        self._latest = LatestState(state.spec)
        self._changed = threading.Condition()
        self._since = time.monotonic()
        self._session = listen(
            state.router,
            state.spec.swarm,
            {
                Beacon: self._on_beacon,
                Decision: self._on_decision,
                Detections: self._on_detections,
                GatewayState: self._on_gateway_state,
                NetState: self._on_net_state,
            },
            state.spec.ego,
            on_join=self._on_join,
            on_leave=self._on_leave,
            timeout_s=timeout_s,
        )
        if len(state.spec.all_egos) > 1:
            hear(self._session, {Decision: self._on_any_decision})

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def alive(self) -> frozenset[str]:
        """The robots whose liveliness token is present."""
        with self._changed:
            return frozenset(self._latest.alive)

    def sensing(self) -> frozenset[str]:
        """The robots that have sent a beacon: their sensor works."""
        with self._changed:
            return frozenset(self._latest.beacons)

    def decided(self) -> bool:
        """Whether a valid decision has come."""
        with self._changed:
            return self._latest.decision is not None and self._latest.decision.valid

    def undecided(self) -> tuple[str, ...]:
        """The egos of which no valid decision has come yet."""
        with self._changed:
            heard = {ego: one.valid for ego, (one, _) in self._latest.by_ego().items()}
            return tuple(ego for ego in self._state.spec.all_egos if not heard.get(ego))

    def cell(self) -> LinkState | None:
        """The cell towards the ego, where the network controller says that it is shaped."""
        with self._changed:
            return self._latest.cell(time.monotonic())

    def link_problems(self) -> tuple[str, ...]:
        """Why links are not as they should be, in the words of the network controller that has the
        ego's link; nothing while it does not answer."""
        with self._changed:
            name = self._latest.controllers.of(self._latest.deciding(), time.monotonic()) or ""
        try:
            return (
                self._session.ask(
                    keyspace.net_shape(self._session.swarm, name),
                    ShapeRequest(profile="show"),
                    ShapeReply,
                    timeout_s=CONNECT_S,
                    traffic=TrafficClass.CONTROL,
                )
                .result()
                .message.notes
            )
        except TransportError:
            return ()

    def ask_unheard(self) -> None:
        """Asks the robots that are not heard whether they are on duty; takes DUTY_S at most, and no
        time when all are heard."""
        swarm = self._session.swarm
        with self._changed:
            now = time.monotonic()
            robots = [r for r in self._latest.ids() if not self._latest.is_heard(r, now)]
        asked = {
            robot: self._session.ask(
                keyspace.robot_steering(swarm, robot),
                RobotSteering(duty="ask"),
                RobotSteered,
                timeout_s=DUTY_S,
                traffic=TrafficClass.CONTROL,
            )
            for robot in robots
        }
        wait(asked.values(), timeout=DUTY_S + 0.5)
        replies = {
            robot: answer.result().message if answer.done() and answer.exception() is None else None
            for robot, answer in asked.items()
        }
        with self._changed:
            self._latest.duties = replies

    def wait(self, timeout_s: float) -> None:
        """Returns when a robot has joined or left or a decision has come, or after the time."""
        with self._changed:
            self._changed.wait(timeout_s)

    def view(self) -> SwarmView:
        """What has come since the last view, and starts to count anew."""
        with self._changed:
            now = time.monotonic()
            view = self._latest.view(self._state.runtime, max(now - self._since, 1e-3), now)
            self._latest.count_anew()
            self._since = now
        return view

    def _on_join(self, robot: str) -> None:
        with self._changed:
            self._latest.alive.add(robot)
            self._changed.notify_all()

    def _on_leave(self, robot: str) -> None:
        with self._changed:
            self._latest.alive.discard(robot)
            self._changed.notify_all()

    def _on_beacon(self, beacon: Beacon) -> None:
        with self._changed:
            self._latest.beacons[beacon.robot] = (beacon, time.monotonic())

    def _on_decision(self, decision: Decision) -> None:
        with self._changed:
            self._latest.decision = decision
            self._latest.decision_at = time.monotonic()
            self._changed.notify_all()

    def _on_any_decision(self, decision: Decision) -> None:
        ego = decision.stands_in_for or decision.ego
        with self._changed:
            if ego in self._state.spec.all_egos:
                self._latest.others[ego] = (decision, time.monotonic())
                self._changed.notify_all()

    def _on_net_state(self, state: NetState) -> None:
        with self._changed:
            self._latest.controllers.take(state, time.monotonic())
            self._changed.notify_all()

    def _on_gateway_state(self, state: GatewayState) -> None:
        with self._changed:
            self._latest.gateway = state

    def _on_detections(self, detections: Detections) -> None:
        with self._changed:
            self._latest.detections += 1
            received = self._latest.bytes
            for robot, count in detections.bytes.items():
                received[robot] = received.get(robot, 0) + count
