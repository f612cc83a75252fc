"""What goes wrong in a swarm, told once when it begins and once when it ends."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Literal

from options.console.board import now_s
from swarm.messages import Decision, GatewayState, NetDemand

SILENT_S = 2.0
"""Robots send beacons ten times a second."""
STALE_S = 4.0
"""`net/state` comes once a second."""
EGO_SILENT_S = 5.0
PERIODS = 3
"""An ego that decides rarely is silent after this many of its own periods."""
EGO_UNKNOWN_S = 60.0
"""Until its second decision nobody knows how rarely it decides."""
DUTY_S = 1.0
"""A robot whose token has gone is lost when it has not said for so long that it is off duty."""
SETTLE_S = 3.0
"""What is there within this time of the start is no news."""

Level = Literal["fault", "good", "note"]
Say = Callable[[dict[str, Any]], None]


class Faults:
    """Turns what comes, and what does not, into events. Times are seconds on a steady clock: one
    that is set back would hide a silence."""

    def __init__(self, ego: str, say: Say) -> None:
        self._ego = ego
        self._say = say
        self._open: set[str] = set()
        self._alive: dict[str, bool] = {}
        self._gone: dict[str, tuple[float, float]] = {}
        """Robots of which nobody knows yet why their token has gone: when, on the steady clock and
        as events tell it."""
        self._connected_at: float | None = None
        """Since when the router is reached, or was last."""
        self._decided_at: float | None = None
        self._cycle = 0
        self._gaps: deque[float] = deque(maxlen=4)
        """Between the last decisions, seconds."""
        self._net_at: float | None = None

    def tick(self, now: float, connected: bool, heard: Mapping[str, float]) -> None:
        """What is missing. `heard` tells when the last beacon of each living robot came."""
        if not connected:
            if self._holds("swarm", self._connected_at is not None):
                self._tell("fault", "the swarm's router cannot be reached")
            return
        back = self._ends("swarm", True)
        if back:
            self._tell("good", "the swarm's router answers again")
        if back or self._connected_at is None:
            self._connected_at = now
        for robot in [r for r, (at, _) in self._gone.items() if now - at >= DUTY_S]:
            self._lost(robot)
        for robot, at in heard.items():
            if self._missing(f"silent {robot}", now, at, SILENT_S):
                self._tell("fault", f"{robot} is alive but sends no beacons", robot)
        if self._missing("ego", now, self._decided_at, self._patience_s()):
            self._tell("fault", f"ego {self._ego} decides no more", self._ego)
        if self._missing("net", now, self._net_at, STALE_S):
            self._tell("fault", "telemetry of the links is stale: C(t) is not measured")

    def beacon(self, robot: str) -> None:
        """A robot has told where it is."""
        if self._ends(f"silent {robot}", True):
            self._tell("good", f"{robot} sends beacons again", robot)

    def stalled(self, robot: str) -> None:
        """A robot that is alive but silent does not answer either."""
        self._tell("fault", f"{robot} stands still: it is alive but answers nothing", robot)

    def alive(self, now: float, robot: str, alive: bool) -> None:
        """A robot's liveliness token has come or gone."""
        before, self._alive[robot] = self._alive.get(robot), alive
        if not alive and before:
            self._gone[robot] = now, now_s()
        elif alive and before is False:
            self._lost(robot)
            self._tell("good", f"{robot} is back", robot)
        elif alive and self._connected_at is not None and now - self._connected_at > SETTLE_S:
            self._tell("note", f"{robot} has joined", robot)
        self._open.discard(f"silent {robot}")

    def forget(self, robot: str) -> None:
        """Nothing is kept of a robot that has left."""
        self._lost(robot)
        self._alive.pop(robot, None)
        self._open -= {f"silent {robot}", f"unreadable {robot}"}

    def off_duty(self, robot: str, operator: str) -> None:
        """A robot that has left was taken off duty."""
        self._gone.pop(robot, None)
        self._tell("note", f"{robot} was taken off duty by {operator or 'an operator'}", robot)

    def gateway(self, alive: bool) -> None:
        """The LLM gateway has come or gone."""
        if self._holds("gateway", not alive):
            self._tell("fault", "the LLM gateway is away")
            # What ails its model is not known any more.
            self._open.discard("model")
        elif self._ends("gateway", alive):
            self._tell("good", "the LLM gateway is back")

    def gateway_state(self, state: GatewayState) -> None:
        """The LLM gateway has told how its model stands."""
        if self._holds("model", bool(state.trouble)):
            self._tell("fault", f"the language model does not answer: {state.trouble}")
        elif self._ends("model", not state.trouble):
            self._tell("good", f"the language model answers again: {state.model}")

    def decision(self, now: float, decision: Decision) -> None:
        """The ego has decided."""
        if decision.ego != self._ego:
            self._ego, first = decision.ego, decision.stands_in_for
            self._cycle, self._decided_at = 0, None
            self._open.discard("ego")
            if first is None:
                self._tell("good", f"ego {self._ego} decides itself again", self._ego)
            else:
                self._tell("fault", f"ego {self._ego} stands in for {first}", self._ego)
        if self._ends("ego", True):
            self._tell("good", f"ego {self._ego} decides again", self._ego)
        if decision.cycle < self._cycle:
            self._tell("note", f"ego {self._ego} has started anew", self._ego)
        elif self._decided_at is not None:
            self._gaps.append(now - self._decided_at)
        self._decided_at, self._cycle = now, decision.cycle
        if self._holds("valid", not decision.valid):
            self._tell("fault", f"no valid decision: {decision.reason}")
        elif self._ends("valid", decision.valid):
            self._tell("good", "decisions are valid again")
        if self._holds("blind", bool(decision.blind)):
            self._tell("fault", f"ego {self._ego} is blind: {decision.blind}", self._ego)
        elif self._ends("blind", not decision.blind):
            self._tell("good", f"ego {self._ego} is not blind any more", self._ego)

    def demand(self, demand: NetDemand) -> None:
        """What the ego needs of its link."""
        feasible = demand.possible and demand.reachable
        if self._holds("feasible", not feasible):
            why = "C(t) is too small" if demand.possible else "no choice of robots reaches it"
            self._tell("fault", f"Q_min {demand.q_min:g} is infeasible: {why}")
        elif self._ends("feasible", feasible):
            self._tell("good", f"Q_min {demand.q_min:g} can be reached again")

    def net_state(self, now: float) -> None:
        """The network controller has spoken."""
        self._net_at = now
        if self._ends("net", True):
            self._tell("good", "telemetry of the links comes again")

    def unreadable(self, robot: str, why: str) -> None:
        """A message passed validation, but its arrays do not fit together."""
        if self._holds(f"unreadable {robot}", True):
            self._tell("fault", f"{robot} sends arrays that cannot be read: {why}", robot)

    def _lost(self, robot: str) -> None:
        """A robot has left, and nobody has said why."""
        if robot in self._gone:
            _, at = self._gone.pop(robot)
            self._say({"at": at, "level": "fault", "text": f"{robot} is lost", "robot": robot})

    def _patience_s(self) -> float:
        """After how long without a decision the ego decides no more."""
        if not self._gaps:
            return EGO_UNKNOWN_S
        # The least gap is the ego's period; a longer one may have been an outage.
        return max(EGO_SILENT_S, PERIODS * min(self._gaps))

    def _missing(self, name: str, now: float, at: float | None, patience_s: float) -> bool:
        """Whether what came last at `at` has been missing too long, and was not before. While the
        router was away nothing could come."""
        if at is None or self._connected_at is None:
            return False
        return self._holds(name, now - max(at, self._connected_at) > patience_s)

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

    def _tell(self, level: Level, text: str, robot: str = "") -> None:
        self._say({"level": level, "text": text[:400], "robot": robot})
