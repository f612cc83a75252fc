"""What robots are told of how they fit: why they cannot be chosen, or what is odd about them."""

from __future__ import annotations

from collections.abc import Mapping

from ego_agent.analyze.scene import DUPLICATE
from ego_agent.knowledge.model import Snapshot
from swarm.fitting import remark
from swarm.messages.ego import MAX_NAMED
from swarm.version import installed_version

MAX_TOLD = 64
MAX_CHARS = 400
"""As `NetDemand.told` allows."""


def remarks(snapshot: Snapshot) -> dict[str, str]:
    """What is odd about robots that may take part all the same."""
    own = installed_version()
    found = {
        robot: remark(view.clock_offset_s, own, view.beacon.software)
        for robot, view in snapshot.robots.items()
        if robot != snapshot.ego and view.alive and view.beacon is not None
    }
    odd = sorted((robot, words) for robot, words in found.items() if words)
    return dict(odd[:MAX_NAMED])


def told(snapshot: Snapshot, odd: Mapping[str, str]) -> dict[str, str]:
    """What robots should know of themselves: those that do not fit come before the `odd` ones, of
    which `remarks` tells."""
    misfits = {
        robot: view.misfit or DUPLICATE
        for robot, view in snapshot.robots.items()
        if robot != snapshot.ego and view.alive and (view.misfit or view.duplicate)
    }
    others = {robot: words for robot, words in odd.items() if robot not in misfits}
    chosen = [*sorted(misfits.items()), *sorted(others.items())][:MAX_TOLD]
    return {robot: words[:MAX_CHARS] for robot, words in chosen}
