"""What of the ego's cell is left for observations."""

from __future__ import annotations

from ego_agent.knowledge.model import Snapshot
from ego_agent.plan.control_budget import ControlBudget
from swarm.messages import encode

BEACON_HZ = 10.0
SCENE_HZ = 2.0
HEADERS = 1.044
"""Bytes on the wire for each of a payload: Ethernet's, IP's and TCP's headers."""


def control_bps(seen: Snapshot) -> float:
    """What the beacons and scene descriptions of all robots but the ego take of its cell: as often
    as they come, at most what the ego grants."""
    most_bps = ControlBudget().take(seen, now_s=0.0).each_bps
    total = 0.0
    for view in seen.robots.values():
        if view.robot != seen.ego and view.beacon is not None:
            told = BEACON_HZ * len(encode(view.beacon))
            told += SCENE_HZ * len(encode(view.scene)) if view.scene is not None else 0.0
            total += min(8.0 * told, most_bps or 8.0 * told)
    return total


def left_bps(capacity_bps: float, control: float) -> float:
    """What payloads have of a cell beside control traffic, which goes first; at least 1."""
    return max(1.0, capacity_bps / HEADERS - control)
