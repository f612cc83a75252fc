"""How much robots may tell of themselves, so that beacons and scenes never fill the ego's link.

They queue before the ego's link, where no robot sees it: the ego tells them. What the link carries
bounds them all; each is halved while its beacons stand in a queue, here or on its own link, and
raised when they do not (as TCP's congestion control does with its window; RFC 5681).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ego_agent.knowledge.control_share import FULL_BPS, MOST_SHARE, NEEDED_BPS, carried_bps
from ego_agent.knowledge.model import Snapshot

LEAST_BPS = 2_000
"""One beacon in two seconds: too few to be relied on, enough to be found again."""
STANDING_S = 0.4
"""Beacons that are longer on their way stand in a queue."""
LOST_S = 1.0
"""Beacons that are so long on their way are of no use: then even less than NEEDED_BPS is better."""
DUE_S = 1.5
"""Beacons come at least this often; what is missing longer stands in the queue, too."""
RECENT_S = 1.0
"""A beacon that came quickly longer ago, a cycle, says nothing of the queue now."""
CLEAR_S = 0.1
RISE = 1.2
"""A cycle, while beacons come quickly."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What robots' beacons and scenes may take, bit/s."""

    each_bps: int
    """Of every robot; 0 for no limit."""
    fewer_bps: dict[str, int]
    """Of robots whose own beacons stand in a queue."""


@dataclass(slots=True)
class _Level:
    """What one robot may take, as its beacons tell."""

    bps: float = float(FULL_BPS)
    cut_at: float = -math.inf


def beacons_stand(snapshot: Snapshot) -> bool:
    """Whether no beacon of a living robot has come quickly for a cycle: they all stand in the
    queue before the ego."""
    others = [v for v in snapshot.robots.values() if v.alive and v.robot != snapshot.ego]
    return bool(others) and all(
        view.beacon is None or view.delay_s >= STANDING_S or view.unheard_s >= RECENT_S
        for view in others
    )


class ControlBudget:
    """Says in every cycle what the beacons and scenes of each robot may take."""

    def __init__(self) -> None:
        self._levels: dict[str, _Level] = {}
        self.too_narrow = ""
        """In words, that the link does not carry what all living robots need to be known at all;
        empty where it does."""

    def take(self, snapshot: Snapshot, now_s: float) -> Wish:
        """The wish of a cycle at `now_s`, seconds on a steady clock."""
        alive = [view for view in snapshot.robots.values() if view.alive]
        each_bps = snapshot.capacity_bps / max(1, len(alive))
        self.too_narrow = (
            f"C(t) of {snapshot.capacity_bps / 1e3:.0f} kbit/s is too narrow for the beacons of "
            f"{len(alive)} robots"
            if each_bps * MOST_SHARE < NEEDED_BPS
            else ""
        )
        most_bps = carried_bps(each_bps)
        for gone in self._levels.keys() - {view.robot for view in alive}:
            del self._levels[gone]
        fewer = {}
        for view in alive:
            if view.robot == snapshot.ego or view.beacon is None:
                continue
            level = self._levels.setdefault(view.robot, _Level())
            _follow(level, max(view.delay_s, view.unheard_s - DUE_S), now_s)
            if level.bps < min(most_bps, FULL_BPS):
                fewer[view.robot] = round(level.bps)
        limit = 0 if most_bps >= FULL_BPS else max(LEAST_BPS, round(most_bps))
        return Wish(limit, fewer)


def _follow(level: _Level, delay_s: float, now_s: float) -> None:
    """Halves a level while the robot's beacons stand in a queue, and raises it when they do not."""
    if delay_s >= STANDING_S:
        # A cut shows when what was on its way before it has come.
        if now_s - level.cut_at >= min(delay_s, 2.0):
            floor_bps = LEAST_BPS if delay_s >= LOST_S else NEEDED_BPS
            level.bps = max(min(floor_bps, level.bps), level.bps / 2.0)
            level.cut_at = now_s
    elif delay_s <= CLEAR_S:
        level.bps = min(float(FULL_BPS), level.bps * RISE)
