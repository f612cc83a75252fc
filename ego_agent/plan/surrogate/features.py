"""What the surrogate sees of a scene and of a choice: numbers that say how much the participants
show of what lies around the ego, how often, and from how near."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.union import pack_areas

NEAR_M = 25.0
"""Boxes count within this of the ego along x and y; about the area of the factory's detector."""
STANDS_BEFORE_M = 1.5
"""Ground is seen up to a robot's body, not where it stands."""
CLEAR_M = 10.0
"""A robot this near is seen with many points; farther ones with fewer."""
NAMES = (
    "area_near", "area", "evidence_near", "evidence_twice", "evidence_mean", "robots_seen",
    "robots_view", "robots_in", "participants", "participants_near", "distance_mean",
    "distance_least", "objects_near", "robots_near", "area_alone", "evidence_alone", "area_of_all",
)  # fmt: skip
"""Of the set of participants and of the scene; then comes a column an algorithm."""


class SceneFeatures:
    """The features of choices in one scene.

    Row 0 is the ego, row i the (i-1)th candidate, as in `Scorer`.
    """

    def __init__(self, scene: UnifiedScene) -> None:
        robots = (scene.ego, *scene.candidates)
        places = np.array([[r.pose.x, r.pose.y] for r in robots])
        offset = places - places[0]
        self._distance = np.hypot(*offset.T)
        near = (np.abs(offset) <= NEAR_M).all(axis=1)
        self._near = near
        areas = np.stack([robot.area for robot in robots])
        middle, reach = areas.shape[1] // 2, round(NEAR_M / scene.cell_m)
        around = slice(max(0, middle - reach), middle + reach)
        self._bits = pack_areas(areas)
        self._near_bits = pack_areas(areas[:, around, around])
        self._near_cells = areas[0, around, around].size
        evidence = np.stack([robot.evidence for robot in robots]).astype(np.float64)
        close = (np.abs(scene.objects[:, :2] - places[0]) <= NEAR_M).all(axis=1)
        self._evidence = evidence[:, close]
        self._view = _views(areas, places, scene.cell_m)[:, near & (np.arange(len(robots)) > 0)]
        self._others = np.flatnonzero(near[1:]) + 1
        everyone = np.ones((1, len(robots)), dtype=np.bool_)
        alone = np.zeros_like(everyone)
        self._all = self._counts(everyone)[0]
        self._alone = self._counts(alone)[0]

    def sets(self, members: NDArray[np.bool_]) -> NDArray[np.float32]:
        """The features of sets of participants: bool (n, robots) to float32 (n, len(NAMES)). The
        ego is taken to be a member always."""
        counts = self._counts(members)
        most = np.maximum(self._all, 1e-9)
        helpers = members.copy()
        helpers[:, 0] = False
        number = helpers.sum(axis=1)
        far = np.where(helpers, self._distance, 0.0).sum(axis=1) / np.maximum(number, 1)
        least = np.where(helpers, self._distance, np.inf).min(axis=1)
        others = max(1, len(self._others))
        columns = [
            counts[:, 0] / most[0],
            counts[:, 1] / most[1],
            counts[:, 2] / most[2],
            counts[:, 3] / most[3],
            counts[:, 2] / max(1, self._evidence.shape[1]),
            counts[:, 4] / others,
            counts[:, 5] / others,
            helpers[:, self._others].sum(axis=1) / others,
            np.log1p(number) / 2,
            np.log1p((helpers & self._near).sum(axis=1)) / 2,
            far / NEAR_M,
            np.where(number > 0, np.minimum(least, 2 * NEAR_M), 0.0) / NEAR_M,
            *(
                np.full(len(members), value)
                for value in (
                    np.log1p(self._evidence.shape[1]) / 4,
                    np.log1p(len(self._others)) / 2,
                    self._alone[0] / self._near_cells,
                    self._alone[2] / most[2],
                    self._all[0] / self._near_cells,
                )
            ),
        ]
        return np.column_stack(columns).astype(np.float32)

    def _counts(self, members: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Of each set: cells seen near and in all, evidence of the best view and of two views
        together, robots near that are members or in view, and how well they are in view."""
        found = np.zeros((len(members), 6))
        for row, chosen in enumerate(members):
            rows = [0, *(np.flatnonzero(chosen[1:]) + 1)]
            evidence = self._evidence[rows]
            view = self._view[rows].max(axis=0, initial=0.0)
            view[chosen[self._others]] = 1.0
            found[row] = (
                np.bitwise_count(np.bitwise_or.reduce(self._near_bits[rows], axis=0)).sum(),
                np.bitwise_count(np.bitwise_or.reduce(self._bits[rows], axis=0)).sum(),
                evidence.max(axis=0, initial=0.0).sum(),
                np.minimum(evidence.sum(axis=0) / 2, 1.0).sum(),
                (view > 0).sum(),
                view.sum(),
            )
        return found


def with_algorithm(
    sets: NDArray[np.float32], algorithms: Sequence[str], known: Sequence[str]
) -> NDArray[np.float32]:
    """Appends a column for each `known` algorithm, 1 where a row uses it: float32 (n, f + known).
    Raises ValueError for an algorithm that is not known; empty is the ego alone."""
    columns = np.zeros((len(sets), len(known)), dtype=np.float32)
    for row, name in enumerate(algorithms):
        if name:
            columns[row, known.index(name)] = 1.0
    return np.concatenate([sets, columns], axis=1)


def _views(
    areas: NDArray[np.bool_], places: NDArray[np.float64], cell_m: float
) -> NDArray[np.float64]:
    """How well each robot (row) sees each robot (column), in [0, 1]: 0 where the ground in front
    of it is hidden, else the less the farther it is."""
    step = places[None] - places[:, None]
    apart = np.hypot(step[..., 0], step[..., 1])
    before = places[None] - step * (STANDS_BEFORE_M / np.maximum(apart, STANDS_BEFORE_M))[..., None]
    half = areas.shape[1] // 2
    cells = np.floor((before - places[0]) / cell_m).astype(np.intp) + half
    inside = ((cells >= 0) & (cells < areas.shape[1])).all(axis=2)
    column, row = np.where(inside[..., None], cells, 0).transpose(2, 0, 1)
    seen = areas[np.arange(len(areas))[:, None], row, column] & inside
    seen |= apart <= STANDS_BEFORE_M
    view: NDArray[np.float64] = seen * np.minimum(1.0, CLEAR_M / np.maximum(apart, 1e-6))
    return view
