"""Beacons that contradict what others see: a robot is not where it says just because it says so."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ego_agent.analyze.merge import SLACK
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
ENDLESS_M = 1e8
"""A beacon may claim any finite place; the squares of these can be searched."""


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
    witnesses = []
    for index, robot in enumerate(robots):
        view = snapshot.robots[robot]
        if view.scene is not None and view.scene_age_s <= objective.beacon_max_age_s:
            witness = _witness(index, view.scene)
            witnesses += [] if witness is None else [witness]
    for_it, against = _witnessed(witnesses, places, sizes)
    beside = _beside(places, OVERLAP * sizes[:, 1])
    found = {}
    for index, robot in enumerate(robots):
        if robot == snapshot.ego:
            continue
        if index in beside:
            found[robot] = f"it says to stand where {robots[beside[index]]} stands"
        elif against[index] >= WITNESSES and against[index] > for_it[index]:
            found[robot] = f"{against[index]} robots see free ground where it says to stand"
    return found


Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]


@dataclass(frozen=True, slots=True)
class _Witness:
    """What one robot says it sees."""

    index: int
    """Its own number among the places."""
    stands: tuple[float, float]
    objects: NDArray[np.float64]
    """(N, 2)."""
    visible: NDArray[np.float32]
    """(S,)."""


def _witness(index: int, scene: SceneDescription) -> _Witness | None:
    """None for a description that is not valid: it tells nothing."""
    try:
        visible = unpack_finite(scene.visible_m, "visible_m", 1)[:, 0]
        objects = unpack_finite(scene.objects, "objects", 9)[:, :2]
    except MessageError:
        return None
    return _Witness(index, scene.pose[:2], objects.astype(np.float64), visible)


def _witnessed(
    witnesses: list[_Witness], places: NDArray[np.float64], sizes: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """How many others see something at each place (N, 2), and how many see the ground behind it
    through it: int (N,) each. `sizes` (N, 2): of the bodies said to be there.

    Only what is near enough to tell is looked at, so that the work grows with the robots.
    """
    reach = np.hypot(*sizes.T) / 2.0
    there, free = (np.zeros((len(places), len(witnesses)), dtype=np.bool_) for _ in range(2))
    there[_seen_there(witnesses, places, reach)] = True
    free[_seen_through(witnesses, places, sizes, reach)] = True
    free &= ~there
    for number, witness in enumerate(witnesses):
        there[witness.index, number] = free[witness.index, number] = False
    return there.sum(axis=1), free.sum(axis=1)


def _seen_there(
    witnesses: list[_Witness], places: NDArray[np.float64], reach: NDArray[np.float64]
) -> Pairs:
    """Which place has an object of which witness near it: places, and numbers of witnesses."""
    objects = np.concatenate([np.zeros((0, 2)), *(one.objects for one in witnesses)])
    owner = np.repeat(np.arange(len(witnesses)), [len(one.objects) for one in witnesses])
    place, which = _pairs(places, objects, reach + SAME_M)
    near = np.hypot(*(objects[which] - places[place]).T) <= reach[place] + SAME_M
    return place[near], owner[which[near]]


def _seen_through(
    witnesses: list[_Witness],
    places: NDArray[np.float64],
    sizes: NDArray[np.float64],
    reach: NDArray[np.float64],
) -> Pairs:
    """Through which place which witness sees the ground behind it, where its view is fine enough to
    tell: places, and numbers of witnesses."""
    seeing = np.array([at for at, one in enumerate(witnesses) if len(one.visible)], dtype=np.intp)
    if not len(seeing):
        return seeing, seeing
    sectors = np.array([len(witnesses[number].visible) for number in seeing])
    first = np.concatenate([[0], np.cumsum(sectors)[:-1]])
    visible = np.concatenate([witnesses[number].visible for number in seeing])
    stands = np.array([witnesses[number].stands for number in seeing])
    largest = sizes.max(axis=1)
    place, which = _pairs(places, stands, largest * sectors.max() / (FILLED * TWO_PI))
    offset, sectors = places[place] - stands[which], sectors[which]
    away = np.hypot(*offset.T)
    sector = np.arctan2(offset[:, 1], offset[:, 0]) / TWO_PI % 1.0 * sectors
    seen_m = visible[first[which] + np.minimum(sector.astype(np.intp), sectors - 1)]
    fine = (away > reach[place]) & (largest[place] >= FILLED * away * TWO_PI / sectors)
    free = fine & (seen_m >= away + reach[place] + BEYOND_M)
    return place[free], seeing[which[free]]


def _beside(places: NDArray[np.float64], within: NDArray[np.float64]) -> dict[int, int]:
    """By place that has another one nearer than `within` (N,): the nearest one."""
    found: dict[int, tuple[float, int]] = {}
    place, other = _pairs(places, places, within)
    apart = np.hypot(*(places[other] - places[place]).T)
    near = (place != other) & (apart < within[place])
    for at, by, gap in zip(place[near], other[near], apart[near], strict=True):
        found[int(at)] = min(found.get(int(at), (np.inf, 0)), (float(gap), int(by)))
    return {at: by for at, (_, by) in found.items()}


def _pairs(
    places: NDArray[np.float64], points: NDArray[np.float64], within: NDArray[np.float64]
) -> Pairs:
    """All pairs of a place (N, 2) and a point (M, 2) that may be within (N,) of each other, and
    some more: int (P,) each."""
    if not len(points):
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    # What is held back to the end of the world comes nearer, if anything.
    tree = cKDTree(np.clip(points, -ENDLESS_M, ENDLESS_M))
    near = tree.query_ball_point(np.clip(places, -ENDLESS_M, ENDLESS_M), SLACK * within)
    place = np.repeat(np.arange(len(places)), [len(one) for one in near])
    return place, np.fromiter(chain.from_iterable(near), np.intp, len(place))
