"""Beacons that contradict what others see: a robot is not where it says just because it says so."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.model import RobotView, Snapshot
from ego_agent.knowledge.objective import Objective
from swarm.arrays import unpack_finite
from swarm.body import Body
from swarm.errors import MessageError
from swarm.geometry import TWO_PI

WITNESSES = 2
"""So many must see free ground where a robot says that it stands, and more than see it there."""
BEYOND_M = 1.0
"""A witness must see the ground this far behind the place."""
SAME_M = 1.0
"""An object this near to the place, beside half the body, may be the robot."""
OVERLAP = 0.5
"""Two robots whose middles are nearer than this share of a body's width stand in one place."""


def doubted(snapshot: Snapshot, objective: Objective, usual_body: Body) -> dict[str, str]:
    """Robots that several others do not see where they say that they are, and why.

    A witness counts where its view is fine enough to tell: the body must fill a whole sector of
    what it describes. The ego is a witness, and never doubted.
    """
    told = {
        robot: view
        for robot, view in snapshot.robots.items()
        if view.beacon is not None and view.beacon_age_s <= objective.beacon_max_age_s
    }
    witnesses = {
        robot: seen
        for robot, view in told.items()
        if view.scene_age_s <= objective.beacon_max_age_s and (seen := _seen(view)) is not None
    }
    found = {}
    for robot, view in told.items():
        if robot == snapshot.ego or view.beacon is None:
            continue
        body = view.beacon.body or usual_body
        if other := _in_one_place(robot, body, told):
            found[robot] = f"it says to stand where {other} stands"
            continue
        said = [_says(seen, view, body) for other, seen in witnesses.items() if other != robot]
        against, for_it = said.count(False), said.count(True)
        if against >= WITNESSES and against > for_it:
            found[robot] = f"{against} robots see free ground where it says to stand"
    return found


def _in_one_place(robot: str, body: Body, told: Mapping[str, RobotView]) -> str:
    """Another robot that stands in the same place; empty where there is none."""
    x, y = _place(told[robot])
    for other, view in told.items():
        if other != robot and math.dist((x, y), _place(view)) < OVERLAP * body.size[1]:
            return other
    return ""


_Seen = tuple[tuple[float, float], NDArray[np.float32], NDArray[np.float32]]
"""Where a witness stood, how far it sees by sector, and the middles of objects (N, 2)."""


def _seen(view: RobotView) -> _Seen | None:
    if view.scene is None:
        return None
    try:
        visible = unpack_finite(view.scene.visible_m, "visible_m", 1)[:, 0]
        objects = unpack_finite(view.scene.objects, "objects", 9)[:, :2]
    except MessageError:
        return None
    return (view.scene.pose[0], view.scene.pose[1]), visible, objects


def _says(seen: _Seen, view: RobotView, body: Body) -> bool | None:
    """Whether a witness sees the robot there; None where it cannot tell."""
    (x, y), visible, objects = seen
    at = _place(view)
    away = math.dist((x, y), at)
    reach = math.hypot(*body.size[:2]) / 2.0
    if len(objects) and float(np.hypot(*(objects - at).T).min()) <= reach + SAME_M:
        return True
    width = min(body.size[:2])
    if not len(visible) or away <= reach or width < away * TWO_PI / len(visible):
        return None
    azimuth = math.atan2(at[1] - y, at[0] - x) % TWO_PI
    sector = min(int(azimuth / TWO_PI * len(visible)), len(visible) - 1)
    return False if float(visible[sector]) >= away + reach + BEYOND_M else None


def _place(view: RobotView) -> tuple[float, float]:
    """Where a robot's beacon says that it is."""
    assert view.beacon is not None
    return view.beacon.pose[0], view.beacon.pose[1]
