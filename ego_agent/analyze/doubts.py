"""Beacons that contradict what others see: a robot is not where it says just because it says so."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.model import Snapshot
from ego_agent.knowledge.objective import Objective
from swarm.arrays import unpack_finite
from swarm.body import Body
from swarm.errors import MessageError
from swarm.geometry import TWO_PI
from swarm.messages import SceneDescription

WITNESSES = 2
"""So many must see free ground where a robot says that it stands, and more than see it there."""
FILLED = 0.8
"""Share of a sector of a witness's description that the body must fill, for the witness to tell: at
0.65 one true beacon in a hundred is doubted, at 0.8 none was."""
BEYOND_M = 1.0
"""A witness must see the ground this far behind the place."""
SAME_M = 1.0
"""An object this near to the place, beside half the body, may be the robot."""
OVERLAP = 0.5
"""Two robots whose middles are nearer than this share of a body's width stand in one place."""


def doubted(snapshot: Snapshot, objective: Objective, usual_body: Body) -> dict[str, str]:
    """Robots that several others do not see where they say that they are, and why.

    A witness counts where its view is fine enough to tell (FILLED). The ego is a witness, and never
    doubted.
    """
    told = {
        robot: view.beacon
        for robot, view in snapshot.robots.items()
        if view.beacon is not None and view.beacon_age_s <= objective.beacon_max_age_s
    }
    if len(told) < 2:
        return {}
    robots = list(told)
    places = np.array([beacon.pose[:2] for beacon in told.values()])
    sizes = np.array([(beacon.body or usual_body).size[:2] for beacon in told.values()])
    against, for_it = (np.zeros(len(robots), dtype=np.intp) for _ in range(2))
    for index, robot in enumerate(robots):
        view = snapshot.robots[robot]
        if view.scene is not None and view.scene_age_s <= objective.beacon_max_age_s:
            there, free = _witnessed(view.scene, places, sizes)
            there[index] = free[index] = False
            against += free
            for_it += there
    found = {}
    for index, robot in enumerate(robots):
        if robot == snapshot.ego:
            continue
        apart = np.hypot(*(places - places[index]).T)
        apart[index] = np.inf
        other = int(apart.argmin())
        if apart[other] < OVERLAP * sizes[index, 1]:
            found[robot] = f"it says to stand where {robots[other]} stands"
        elif against[index] >= WITNESSES and against[index] > for_it[index]:
            found[robot] = f"{against[index]} robots see free ground where it says to stand"
    return found


def _witnessed(
    scene: SceneDescription, places: NDArray[np.float64], sizes: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """At which places (N, 2) a robot sees something, and through which it sees the ground behind:
    bool (N,) each; neither where it cannot tell. `sizes` (N, 2): of the bodies said to be there."""
    there, free = np.zeros(len(places), dtype=np.bool_), np.zeros(len(places), dtype=np.bool_)
    try:
        visible = unpack_finite(scene.visible_m, "visible_m", 1)[:, 0]
        objects = unpack_finite(scene.objects, "objects", 9)[:, :2]
    except MessageError:
        return there, free
    reach = np.hypot(*sizes.T) / 2.0
    if len(objects):
        apart = np.hypot(*(objects[None].astype(np.float64) - places[:, None]).transpose(2, 0, 1))
        there = apart.min(axis=1) <= reach + SAME_M
    if len(visible):
        offset = places - np.array(scene.pose[:2])
        away = np.hypot(*offset.T)
        sector = np.arctan2(offset[:, 1], offset[:, 0]) / TWO_PI % 1.0 * len(visible)
        seen_m = visible[np.minimum(sector.astype(np.intp), len(visible) - 1)]
        fine = (away > reach) & (sizes.max(axis=1) >= FILLED * away * TWO_PI / len(visible))
        free = fine & ~there & (seen_m >= away + reach + BEYOND_M)
    return there, free
