"""What egos have said last, for the robot's beacons: how fast to speak, and what to echo."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from swarm.messages import NetDemand

MAX_EGOS = 128
MAX_ECHOES = 8
"""In one beacon; what finds no place is echoed by the next one."""
HOLD_S = 5.0
"""A wish holds this long, or for HOLD_PERIODS of its ego's, whichever is longer."""
HOLD_PERIODS = 3.0
FORGET_S = 200.0
"""An ego decides at least once a minute."""


@dataclass(slots=True)
class _Ego:
    """The newest word of one ego."""

    demand: NetDemand
    heard_ns: int
    """When it came, on the robot's steady clock."""
    period_s: float = 0.0
    """Between its last two words."""


class Pace:
    """The newest word of every ego. Zenoh's threads call `on_demand`, one thread the rest."""

    def __init__(self, steady_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._steady_ns = steady_ns
        self._lock = threading.Lock()
        self._egos: dict[str, _Ego] = {}
        self._echoed: dict[tuple[str, str], int] = {}
        """By robot and ego: `steady_ns` of the word that was echoed last."""

    def on_demand(self, demand: NetDemand) -> None:
        """Takes an ego's word."""
        now_ns = self._steady_ns()
        with self._lock:
            known = self._egos.get(demand.ego)
            if known is None:
                self._forget(now_ns)
                if len(self._egos) < MAX_EGOS:
                    self._egos[demand.ego] = _Ego(demand, now_ns)
                return
            known.period_s = (now_ns - known.heard_ns) * 1e-9
            known.demand, known.heard_ns = demand, now_ns

    def echoes(self, robot: str) -> dict[str, tuple[int, int]]:
        """What the next beacon of a robot echoes: words of egos that none has echoed yet."""
        with self._lock:
            said = {ego: (e.demand.steady_ns, e.heard_ns) for ego, e in self._egos.items()}
            new = [
                ego
                for ego, echo in said.items()
                if echo[0] and self._echoed.get((robot, ego)) != echo[0]
            ]
            new.sort(key=lambda ego: said[ego][1])  # who has waited longest first
            news = {ego: said[ego] for ego in new[:MAX_ECHOES]}
            self._echoed |= {(robot, ego): said_ns for ego, (said_ns, _) in news.items()}
        return news

    def control_bps(self, robot: str) -> int | None:
        """Bit/s that a robot's beacons and scenes may take: the least of the wishes in force; None
        where there is none."""
        now_ns = self._steady_ns()
        with self._lock:
            fresh = [
                known.demand
                for known in self._egos.values()
                if (now_ns - known.heard_ns) * 1e-9 <= max(HOLD_S, HOLD_PERIODS * known.period_s)
            ]
        wishes = [bps for d in fresh for bps in (d.control_bps, d.fewer_bps.get(robot)) if bps]
        return min(wishes, default=None)

    def _forget(self, now_ns: int) -> None:
        for ego, known in list(self._egos.items()):
            if (now_ns - known.heard_ns) * 1e-9 > FORGET_S:
                del self._egos[ego]
                self._echoed = {key: at for key, at in self._echoed.items() if key[1] != ego}
