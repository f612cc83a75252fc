"""What goes wrong in a swarm, told once when it begins and once when it ends."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Literal

from swarm.messages import Decision, NetDemand

SILENT_S = 2.0
"""Robots send beacons ten times a second."""
STALE_S = 4.0
"""`net/state` comes once a second."""
EGO_SILENT_S = 5.0
PERIODS = 3
"""An ego that decides rarely is silent after this many of its own periods."""
SETTLE_S = 3.0
"""What is there within this time of the start is no news."""

Level = Literal["fault", "good", "note"]
Say = Callable[[dict[str, Any]], None]


class Faults:
    """Turns what comes, and what does not, into events. Times are seconds since the epoch."""

    def __init__(self, ego: str, say: Say) -> None:
        self._ego = ego
        self._say = say
        self._open: set[str] = set()
        self._alive: dict[str, bool] = {}
        self._connected_at: float | None = None
        self._decided_at: float | None = None
        self._cycle = 0
        self._gaps: deque[float] = deque(maxlen=4)
        """Between the last decisions, seconds."""
        self._net_at: float | None = None

    def tick(self, now: float, connected: bool, heard: Mapping[str, float]) -> None:
        """What is missing. `heard` tells when the last beacon of each living robot came."""
        if self._holds("swarm", not connected and self._connected_at is not None):
            self._tell(now, "fault", "the swarm's router cannot be reached")
        elif self._ends("swarm", connected):
            self._tell(now, "good", "the swarm's router answers again")
        if not connected:
            return
        if self._connected_at is None:
            self._connected_at = now
        for robot, at in heard.items():
            if self._holds(f"silent {robot}", now - at > SILENT_S):
                self._tell(now, "fault", f"{robot} is alive but sends no beacons", robot)
            elif self._ends(f"silent {robot}", now - at <= SILENT_S):
                self._tell(now, "good", f"{robot} sends beacons again", robot)
        # The least gap is the ego's period; a longer one may have been an outage.
        patience_s = max(EGO_SILENT_S, PERIODS * min(self._gaps, default=0.0))
        if self._decided_at is not None and self._holds("ego", now - self._decided_at > patience_s):
            self._tell(now, "fault", f"ego {self._ego} decides no more", self._ego)
        if self._net_at is not None and self._holds("net", now - self._net_at > STALE_S):
            self._tell(now, "fault", "telemetry of the links is stale: C(t) is not measured")

    def alive(self, now: float, robot: str, alive: bool) -> None:
        """A robot's liveliness token has come or gone."""
        before, self._alive[robot] = self._alive.get(robot), alive
        if not alive and before:
            self._tell(now, "fault", f"{robot} is lost", robot)
        elif alive and before is False:
            self._tell(now, "good", f"{robot} is back", robot)
        elif alive and self._connected_at and now - self._connected_at > SETTLE_S:
            self._tell(now, "note", f"{robot} has joined", robot)
        self._open.discard(f"silent {robot}")

    def off_duty(self, now: float, robot: str, operator: str) -> None:
        """A robot that has left was taken off duty."""
        self._tell(now, "note", f"{robot} was taken off duty by {operator or 'an operator'}", robot)

    def gateway(self, now: float, alive: bool) -> None:
        """The LLM gateway has come or gone."""
        if self._holds("gateway", not alive):
            self._tell(now, "fault", "the LLM gateway is away")
        elif self._ends("gateway", alive):
            self._tell(now, "good", "the LLM gateway is back")

    def decision(self, now: float, decision: Decision) -> None:
        """The ego has decided."""
        if self._ends("ego", True):
            self._tell(now, "good", f"ego {self._ego} decides again", self._ego)
        if decision.cycle < self._cycle:
            self._tell(now, "note", f"ego {self._ego} has started anew", self._ego)
        elif self._decided_at is not None:
            self._gaps.append(now - self._decided_at)
        self._decided_at, self._cycle = now, decision.cycle
        if self._holds("valid", not decision.valid):
            self._tell(now, "fault", f"no valid decision: {decision.reason}")
        elif self._ends("valid", decision.valid):
            self._tell(now, "good", "decisions are valid again")

    def demand(self, now: float, demand: NetDemand) -> None:
        """What the ego needs of its link."""
        feasible = demand.possible and demand.reachable
        if self._holds("feasible", not feasible):
            why = "C(t) is too small" if demand.possible else "no choice of robots reaches it"
            self._tell(now, "fault", f"Q_min {demand.q_min:g} is infeasible: {why}")
        elif self._ends("feasible", feasible):
            self._tell(now, "good", f"Q_min {demand.q_min:g} can be reached again")

    def net_state(self, now: float) -> None:
        """The network controller has spoken."""
        self._net_at = now
        if self._ends("net", True):
            self._tell(now, "good", "telemetry of the links comes again")

    def unreadable(self, now: float, robot: str, why: str) -> None:
        """A message passed validation, but its arrays do not fit together."""
        if self._holds(f"unreadable {robot}", True):
            self._tell(now, "fault", f"{robot} sends arrays that cannot be read: {why}", robot)

    def _holds(self, name: str, bad: bool) -> bool:
        """Whether something is bad now and was not before."""
        if not bad or name in self._open:
            return False
        self._open.add(name)
        return True

    def _ends(self, name: str, good: bool) -> bool:
        """Whether something was bad before and is good now."""
        if not good or name not in self._open:
            return False
        self._open.discard(name)
        return True

    def _tell(self, now: float, level: Level, text: str, robot: str = "") -> None:
        self._say({"at": now, "level": level, "text": text[:400], "robot": robot})
