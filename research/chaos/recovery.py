"""How long it took until everybody took part again, in cycles of the ego."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from research.chaos.history import Cycle, History, Played

GRACE_CYCLES = 2
"""A robot that another fault has just let go is not counted for so long."""


class Recovery(msgspec.Struct, frozen=True, kw_only=True):
    """What came after one fault."""

    cycles: int | None
    """Cycles from when what was hit was there again to the first in which everybody whom it hit can
    take part and is heard; 0 where nobody was ever missing. None: that never came."""
    seconds: float | None
    """The same from the fault's end, with the time that a restart takes."""
    disturbed: bool = False
    """Other faults lasted until the end of the run, so that it cannot be told."""


def recovery(history: History, played: Played) -> Recovery:
    """Recovery after one fault.

    A cycle counts only for the robots that no other fault hits meanwhile, and not at all where
    there is none.
    """
    if played.up_s is None:
        return Recovery(cycles=None, seconds=None)
    if not played.hits:
        return Recovery(cycles=0, seconds=played.up_s - played.ended_s)
    others = [one for one in history.played if one is not played]
    grace_s = GRACE_CYCLES * history.period_s
    count = judged = 0
    for cycle in history.cycles:
        if cycle.at_s < played.up_s:
            continue
        left = _left(played, others, cycle, grace_s)
        if not left:
            continue
        judged += 1
        if not any(robot in cycle.out for robot in left):
            return Recovery(cycles=count, seconds=cycle.at_s - played.ended_s)
        count += 1
    return Recovery(cycles=None, seconds=None, disturbed=not judged)


def missing_by(history: History, cycle: Cycle) -> tuple[str, ...]:
    """Robots that are out in a cycle although no fault hits them."""
    grace_s = GRACE_CYCLES * history.period_s
    return tuple(
        robot
        for robot in history.robots
        if robot in cycle.out
        and not any(robot in one.hits and _lasts(one, cycle, grace_s) for one in history.played)
    )


def _left(
    played: Played, others: Sequence[Played], cycle: Cycle, grace_s: float
) -> tuple[str, ...]:
    return tuple(
        robot
        for robot in played.hits
        if not any(robot in other.hits and _lasts(other, cycle, grace_s) for other in others)
    )


def _lasts(played: Played, cycle: Cycle, grace_s: float) -> bool:
    """Whether a cycle lies in a fault or soon after it."""
    if played.up_s is None:
        return played.begun_s <= cycle.at_s
    return played.begun_s <= cycle.at_s <= played.up_s + grace_s
