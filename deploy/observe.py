"""What a running swarm says about itself over Zenoh, gathered for the console."""

from __future__ import annotations

import threading
import time
from concurrent.futures import wait
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from deploy.state import State
from swarm import keyspace
from swarm.controllers import Controllers
from swarm.errors import TransportError
from swarm.listening import hear, listen
from swarm.messages import (
    AdviceReport,
    Assignment,
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
SILENT_S = 2.0
"""Robots tell where they are at least this often, however narrow the link is."""

RobotState = Literal["well", "off duty", "lost", "silent", "stalled"]
"""Lost: neither its token nor its process is there. Silent: its process answers, but no beacons
come. Stalled: its token is there, but its process answers nothing."""


class RobotRow(msgspec.Struct, frozen=True, kw_only=True):
    """One robot, as seen from the host."""

    robot: str
    alive: bool
    """Its liveliness token is present."""
    age_s: float | None
    """Since it sensed what is known of it, here or, if that is older, to the ego; None when no
    beacon has come yet."""
    position: tuple[float, float, float] | None
    """Its sensor in the world frame, metres."""
    distance_m: float | None
    """To the ego, in the ground plane."""
    selected: bool
    """The last decision has it take part."""
    bytes_per_s: float
    """Observations that the ego received from it."""
    state: RobotState | None = None
    """None where that is not known yet."""
    why: str = ""
    """Why the ego leaves it out or gets nothing of it, or who took it off duty."""


class EgoRow(msgspec.Struct, frozen=True, kw_only=True):
    """One ego of several, and the newest decision that was heard of it; None before the first."""

    ego: str
    cycle: int | None = None
    age_s: float | None = None
    """Since the decision came."""
    selected: tuple[str, ...] = ()
    algorithm: str = ""
    policy: str = ""
    source: str = ""
    valid: bool = False
    quality: float = 0.0
    capacity_bps: float | None = None


class SwarmView(msgspec.Struct, frozen=True, kw_only=True):
    """The swarm over the last moments. Fields about the decision are None before the first."""

    swarm: str
    runtime: str
    ego: str
    cycle: int | None
    selected: tuple[str, ...] | None
    algorithm: str | None
    source: str | None
    policy: str | None
    valid: bool | None
    reason: str | None
    capacity_bps: float | None
    """C(t) that the last decision was checked against."""
    cell_bps: int | None
    """What the network controller gives the cell towards the ego; None where it is not shaped."""
    cell_level: int | None
    """How far the controller has moved bandwidth towards fusion."""
    quality: float | None
    bytes_per_s: float
    frames_per_s: float
    """Fused frames that the ego published."""
    robots: tuple[RobotRow, ...]
    model: str | None = None
    """The language model whose advice the decision follows; empty for none."""
    advice: AdviceReport | None = None
    """None for policies that ask no language model."""
    blind: str = ""
    """Why the ego perceives with nobody's help against its will, or not at all."""
    model_trouble: str = ""
    """Why the LLM gateway's model does not answer."""
    stands_in_for: str | None = None
    """The ego in whose stead `ego` decides; None: in its own."""
    unshaped: tuple[str, ...] = ()
    """Why links cannot be shaped, or are not as they should be, in the controllers' words."""
    egos: tuple[EgoRow, ...] = ()
    """Every ego of the swarm, the one that is shown among them."""
    assignments: tuple[Assignment, ...] = ()
    """What each participant sends, and how often, where that is not the same of all."""


@dataclass(slots=True)
class _Heard:
    """What has come so far; written by Zenoh's threads, so only under the watch's lock."""

    beacons: dict[str, tuple[Beacon, float]]
    alive: set[str]
    decision: Decision | None = None
    decision_at: float = 0.0
    detections: int = 0
    bytes: dict[str, int] | None = None
    controllers: Controllers = field(default_factory=Controllers)
    gateway: GatewayState | None = None
    decided: dict[str, tuple[Decision, float]] = field(default_factory=dict)
    """The newest decision of each ego, a standby's as its ego's, and when it came."""
    duties: dict[str, RobotSteered | None] = field(default_factory=dict)
    """What the robots that are not heard said when they were asked; None: nothing."""


class Watch:
    """Listens to one swarm through its router. Use as a context manager."""

    def __init__(self, state: State, timeout_s: float = CONNECT_S) -> None:
        """Raises TransportError when the router cannot be reached in time."""
        self._state = state
        self._heard = _Heard({}, set())
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
            return frozenset(self._heard.alive)

    def sensing(self) -> frozenset[str]:
        """The robots that have sent a beacon: their sensor works."""
        with self._changed:
            return frozenset(self._heard.beacons)

    def decided(self) -> bool:
        """Whether a valid decision has come."""
        with self._changed:
            return self._heard.decision is not None and self._heard.decision.valid

    def undecided(self) -> tuple[str, ...]:
        """The egos of which no valid decision has come yet."""
        with self._changed:
            heard = {ego: one.valid for ego, (one, _) in self._decided().items()}
            return tuple(ego for ego in self._state.spec.all_egos if not heard.get(ego))

    def cell(self) -> LinkState | None:
        """The cell towards the ego, where the network controller says that it is shaped."""
        with self._changed:
            return self._cell()

    def link_problems(self) -> tuple[str, ...]:
        """Why links are not as they should be, in the words of the network controller that has the
        ego's link; nothing while it does not answer."""
        with self._changed:
            name = self._heard.controllers.of(self._ego(), time.monotonic()) or ""
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
            robots = [r for r in self._ids() if not self._is_heard(r, now)]
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
            self._heard.duties = replies

    def wait(self, timeout_s: float) -> None:
        """Returns when a robot has joined or left or a decision has come, or after the time."""
        with self._changed:
            self._changed.wait(timeout_s)

    def view(self) -> SwarmView:
        """What has come since the last view, and starts to count anew."""
        spec = self._state.spec
        with self._changed:
            now = time.monotonic()
            span_s = max(now - self._since, 1e-3)
            heard, decision, cell = self._heard, self._heard.decision, self._cell()
            received = heard.bytes or {}
            rows = tuple(
                self._row(robot, now, received.get(robot, 0) / span_s) for robot in self._ids()
            )
            view = SwarmView(
                swarm=spec.swarm,
                runtime=self._state.runtime,
                ego=self._ego(),
                cycle=decision.cycle if decision else None,
                selected=decision.participants if decision else None,
                algorithm=decision.algorithm if decision else None,
                assignments=decision.assignments if decision else (),
                source=decision.source if decision else None,
                policy=decision.policy if decision else None,
                valid=decision.valid if decision else None,
                reason=decision.reason if decision else None,
                capacity_bps=decision.capacity_bps if decision else None,
                cell_bps=cell.capacity_bps if cell else None,
                cell_level=cell.level if cell else None,
                quality=decision.quality if decision else None,
                bytes_per_s=round(sum(received.values()) / span_s, 1),
                frames_per_s=round(heard.detections / span_s, 2),
                robots=rows,
                model=decision.model if decision else None,
                advice=decision.advice if decision else None,
                blind=decision.blind if decision else "",
                model_trouble=heard.gateway.trouble if heard.gateway else "",
                stands_in_for=decision.stands_in_for if decision else None,
                unshaped=heard.controllers.unshaped(now),
                egos=self._egos(now),
            )
            heard.detections, heard.bytes = 0, None
            self._since = now
        return view

    def _cell(self) -> LinkState | None:
        links = self._heard.controllers.links(time.monotonic())
        own = (self._ego(), "down")
        return next((link for link in links if (link.robot, link.direction) == own), None)

    def _ego(self) -> str:
        """The ego that decides: the specification's, or the one that stands in for it."""
        decision = self._heard.decision
        return decision.ego if decision else self._state.spec.ego

    def _decided(self) -> dict[str, tuple[Decision, float]]:
        """The newest decision of each ego."""
        heard = self._heard
        if heard.decision is None:
            return heard.decided
        return {self._state.spec.ego: (heard.decision, heard.decision_at), **heard.decided}

    def _egos(self, now: float) -> tuple[EgoRow, ...]:
        decided = self._decided()
        rows = []
        for ego in self._state.spec.all_egos:
            if ego not in decided:
                rows.append(EgoRow(ego=ego))
                continue
            decision, at = decided[ego]
            row = EgoRow(
                ego=decision.ego,
                cycle=decision.cycle,
                age_s=round(now - at, 2),
                selected=decision.participants,
                algorithm=decision.algorithm,
                policy=decision.policy,
                source=decision.source,
                valid=decision.valid,
                quality=round(decision.quality, 4),
                capacity_bps=decision.capacity_bps,
            )
            rows.append(row)
        return tuple(rows)

    def _ids(self) -> list[str]:
        """The swarm's robots in their order, then those that joined from elsewhere."""
        known = self._state.spec.robots
        return [*known, *sorted((self._heard.alive | self._heard.beacons.keys()) - set(known))]

    def _row(self, robot: str, now: float, bytes_per_s: float) -> RobotRow:
        beacons, decision = self._heard.beacons, self._heard.decision
        beacon, _ = beacons.get(robot, (None, 0.0))
        ego = beacons.get(self._ego())
        pose = beacon.sensor_pose() if beacon else None
        age_s = self._age_s(robot, now)
        state = self._state_of(robot, now)
        return RobotRow(
            robot=robot,
            alive=robot in self._heard.alive,
            age_s=None if age_s is None else round(age_s, 3),
            position=tuple(round(v, 3) for v in beacon.pose[:3]) if beacon else None,  # type: ignore[arg-type]
            distance_m=round(pose.distance_to(ego[0].sensor_pose()), 3) if pose and ego else None,
            selected=decision is not None and robot in decision.participants,
            bytes_per_s=round(bytes_per_s, 1),
            state=state,
            why=self._why(robot, state),
        )

    def _age_s(self, robot: str, now: float) -> float | None:
        """Since the robot sensed what is known of it, here or, if older, to the ego."""
        decision = self._heard.decision
        told_s = decision.ages_s.get(robot) if decision else None
        beacon, came = self._heard.beacons.get(robot, (None, 0.0))
        if beacon is None:
            return told_s
        here_s = now - came + max(0.0, (beacon.sent_ns - beacon.capture_ns) * 1e-9)
        return max(here_s, told_s or 0.0)

    def _is_heard(self, robot: str, now: float) -> bool:
        age_s = self._age_s(robot, now)
        return robot in self._heard.alive and age_s is not None and age_s <= SILENT_S

    def _state_of(self, robot: str, now: float) -> RobotState | None:
        if self._is_heard(robot, now):
            return "well"
        if robot not in self._heard.duties:
            return None
        duty = self._heard.duties[robot]
        if robot in self._heard.alive:
            return "silent" if duty else "stalled"
        return "off duty" if duty and not duty.on_duty else "lost"

    def _why(self, robot: str, state: RobotState | None) -> str:
        duty, decision = self._heard.duties.get(robot), self._heard.decision
        if state == "off duty" and duty is not None:
            return f"by {duty.operator or 'an operator'}"
        if decision is None:
            return ""
        told = (decision.silent, decision.excluded, decision.doubted, decision.remarks)
        return next((reasons[robot] for reasons in told if robot in reasons), "")

    def _on_join(self, robot: str) -> None:
        with self._changed:
            self._heard.alive.add(robot)
            self._changed.notify_all()

    def _on_leave(self, robot: str) -> None:
        with self._changed:
            self._heard.alive.discard(robot)
            self._changed.notify_all()

    def _on_beacon(self, beacon: Beacon) -> None:
        with self._changed:
            self._heard.beacons[beacon.robot] = (beacon, time.monotonic())

    def _on_decision(self, decision: Decision) -> None:
        with self._changed:
            self._heard.decision = decision
            self._heard.decision_at = time.monotonic()
            self._changed.notify_all()

    def _on_any_decision(self, decision: Decision) -> None:
        ego = decision.stands_in_for or decision.ego
        with self._changed:
            if ego in self._state.spec.all_egos:
                self._heard.decided[ego] = (decision, time.monotonic())
                self._changed.notify_all()

    def _on_net_state(self, state: NetState) -> None:
        with self._changed:
            self._heard.controllers.take(state, time.monotonic())
            self._changed.notify_all()

    def _on_gateway_state(self, state: GatewayState) -> None:
        with self._changed:
            self._heard.gateway = state

    def _on_detections(self, detections: Detections) -> None:
        with self._changed:
            self._heard.detections += 1
            received = self._heard.bytes = self._heard.bytes or {}
            for robot, count in detections.bytes.items():
                received[robot] = received.get(robot, 0) + count
