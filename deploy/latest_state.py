"""The latest state of a running swarm, as its messages tell it, for who looks at it."""

from __future__ import annotations

from dataclasses import dataclass, field

from deploy.spec import SwarmSpec
from deploy.view import EgoRow, RobotRow, RobotState, SwarmView
from swarm.controllers import Controllers
from swarm.messages import Beacon, Decision, GatewayState, LinkState, RobotSteered

SILENT_S = 2.0
"""Robots tell where they are at least this often, however narrow the link is."""


@dataclass(slots=True)
class LatestState:
    """What has come so far. Times are of `time.monotonic`, in seconds."""

    spec: SwarmSpec
    beacons: dict[str, tuple[Beacon, float]] = field(default_factory=dict)
    alive: set[str] = field(default_factory=set)
    decision: Decision | None = None
    """The newest of the swarm's first ego, or of who stands in for it."""
    decision_at: float = 0.0
    others: dict[str, tuple[Decision, float]] = field(default_factory=dict)
    """The newest decision of every ego, where there are several, and when it came."""
    detections: int = 0
    bytes: dict[str, int] = field(default_factory=dict)
    controllers: Controllers = field(default_factory=Controllers)
    gateway: GatewayState | None = None
    duties: dict[str, RobotSteered | None] = field(default_factory=dict)
    """What the robots that are not heard said when they were asked; None: nothing."""

    def deciding(self) -> str:
        """The ego that decides: the specification's, or the one that stands in for it."""
        decision = self.decision
        return decision.ego if decision else self.spec.ego

    def by_ego(self) -> dict[str, tuple[Decision, float]]:
        """The newest decision of each ego, a standby's as its ego's, and when it came."""
        if self.decision is None:
            return self.others
        return {self.spec.ego: (self.decision, self.decision_at), **self.others}

    def ids(self) -> list[str]:
        """The swarm's robots in their order, then those that joined from elsewhere."""
        known = self.spec.robots
        return [*known, *sorted((self.alive | self.beacons.keys()) - set(known))]

    def is_heard(self, robot: str, now: float) -> bool:
        """Whether what is known of it is new, at most SILENT_S old."""
        age_s = self._age_s(robot, now)
        return robot in self.alive and age_s is not None and age_s <= SILENT_S

    def cell(self, now: float) -> LinkState | None:
        """The cell towards the ego that decides, where a controller says that it is shaped."""
        links = self.controllers.links(now)
        own = (self.deciding(), "down")
        return next((link for link in links if (link.robot, link.direction) == own), None)

    def view(self, runtime: str, span_s: float, now: float) -> SwarmView:
        """What came within the last `span_s` seconds."""
        decision, cell = self.decision, self.cell(now)
        rows = tuple(
            self._row(robot, now, self.bytes.get(robot, 0) / span_s) for robot in self.ids()
        )
        return SwarmView(
            swarm=self.spec.swarm,
            runtime=runtime,
            ego=self.deciding(),
            cycle=decision.cycle if decision else None,
            selected=decision.participants if decision else None,
            algorithm=decision.algorithm if decision else None,
            source=decision.source if decision else None,
            policy=decision.policy if decision else None,
            valid=decision.valid if decision else None,
            reason=decision.reason if decision else None,
            capacity_bps=decision.capacity_bps if decision else None,
            cell_bps=cell.capacity_bps if cell else None,
            cell_level=cell.level if cell else None,
            quality=decision.quality if decision else None,
            bytes_per_s=round(sum(self.bytes.values()) / span_s, 1),
            frames_per_s=round(self.detections / span_s, 2),
            robots=rows,
            model=decision.model if decision else None,
            advice=decision.advice if decision else None,
            blind=decision.blind if decision else "",
            model_trouble=self.gateway.trouble if self.gateway else "",
            stands_in_for=decision.stands_in_for if decision else None,
            unshaped=self.controllers.unshaped(now),
            egos=self._ego_rows(now),
            intents=decision.intents if decision else (),
            assignments=decision.assignments if decision else (),
        )

    def count_anew(self) -> None:
        """Forgets the bytes and frames of the window that was shown."""
        self.detections = 0
        self.bytes.clear()

    def _row(self, robot: str, now: float, bytes_per_s: float) -> RobotRow:
        beacons, decision = self.beacons, self.decision
        beacon, _ = beacons.get(robot, (None, 0.0))
        ego = beacons.get(self.deciding())
        pose = beacon.sensor_pose() if beacon else None
        age_s = self._age_s(robot, now)
        state = self._state_of(robot, now)
        return RobotRow(
            robot=robot,
            alive=robot in self.alive,
            age_s=None if age_s is None else round(age_s, 3),
            position=tuple(round(v, 3) for v in beacon.pose[:3]) if beacon else None,  # type: ignore[arg-type]
            distance_m=round(pose.distance_to(ego[0].sensor_pose()), 3) if pose and ego else None,
            selected=decision is not None and robot in decision.participants,
            bytes_per_s=round(bytes_per_s, 1),
            state=state,
            why=self._why(robot, state),
        )

    def _ego_rows(self, now: float) -> tuple[EgoRow, ...]:
        decided = self.by_ego()
        rows = []
        for ego in self.spec.all_egos:
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

    def _state_of(self, robot: str, now: float) -> RobotState | None:
        if self.is_heard(robot, now):
            return "well"
        if robot not in self.duties:
            return None
        duty = self.duties[robot]
        if robot in self.alive:
            return "silent" if duty else "stalled"
        return "off duty" if duty and not duty.on_duty else "lost"

    def _why(self, robot: str, state: RobotState | None) -> str:
        duty, decision = self.duties.get(robot), self.decision
        if state == "off duty" and duty is not None:
            return f"by {duty.operator or 'an operator'}"
        if decision is None:
            return ""
        told = (decision.silent, decision.excluded, decision.doubted, decision.remarks)
        return next((reasons[robot] for reasons in told if robot in reasons), "")

    def _age_s(self, robot: str, now: float) -> float | None:
        """Since the robot sensed what is known of it, here or, if older, to the ego."""
        decision = self.decision
        told_s = decision.ages_s.get(robot) if decision else None
        beacon, came = self.beacons.get(robot, (None, 0.0))
        if beacon is None:
            return told_s
        here_s = now - came + max(0.0, (beacon.sent_ns - beacon.capture_ns) * 1e-9)
        return max(here_s, told_s or 0.0)
