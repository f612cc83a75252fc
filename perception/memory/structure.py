"""Where walls and racks stand: what is remembered of a place beside its objects.

What is cut out of a wall, by the few directions in which robots send it or by the places that the
ego asked about, looks like an object more easily than a whole one. No object stands where something
is that is taller than any; so a box there is less likely to be one, by Bayes' rule.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from perception.scene.structure import above_objects
from perception.types import Boxes, clean_points
from swarm.geometry import Matrix, Points, transform

CELL_M = 0.2
"""Side of a cell, seen from above."""
LEARNT_S = 1.0
"""Of each robot's views, one in this time."""
LASTS_S, FORGOTTEN_S = 0.9, 5.0
"""What is shown again so long after it was first, stays there: a tall load that drives by does not.
What nobody has shown for so long may have been moved."""
MOST_CELLS = 50_000
"""The newest; a hall of 100 m by 60 m with its racks has some 20,000."""
CORE, STEPS, ENOUGH = 0.5, 6, 0.25
"""An object may touch a wall, but not stand in it: of the inner half of a body's footprint, looked
at in so many places along each side, this part lies on structure."""
LESS_LIKELY = 0.2
"""Odds that a box is an object there, of what they are elsewhere. On 20 floors of the seeds from
1,981,400 on 25 of 153 false boxes stood there, and none of 5,246 true ones."""
_ROW = 1 << 32


class Structure:
    """The cells of the world's ground plane on which structure was seen of late."""

    def __init__(self, tallest_m: float) -> None:
        """`tallest_m`: no object is taller; infinity: nothing is structure."""
        self._tallest_m = tallest_m
        self.clear()

    def __len__(self) -> int:
        return len(self._cells)

    def clear(self) -> None:
        """Forgets everything."""
        self._cells = np.zeros(0, dtype=np.int64)
        """(N,), in order."""
        self._first_s, self._last_s = np.zeros((2, 0))
        """(N,): when each was seen first and last."""
        self._learnt_s: dict[str, float] = {}
        """By robot, the time of the last view that counted."""

    def learn(self, time_s: float, views: Mapping[str, tuple[Points, Matrix]]) -> None:
        """Takes up what robots see at a time, by robot: points float32 (N, 3) in the sensor's
        frame, and the sensor in the world frame, 4 x 4. Times do not fall."""
        due = [r for r in views if time_s - self._learnt_s.get(r, -math.inf) >= LEARNT_S]
        if math.isinf(self._tallest_m) or not due:
            return
        shown = [np.zeros(0, dtype=np.int64)]
        for robot in due:
            points, world_from_sensor = views[robot]
            self._learnt_s[robot] = time_s
            cloud = clean_points(points)
            cloud = cloud.compress(above_objects(cloud, self._tallest_m), axis=0)
            shown.append(_cells(transform(world_from_sensor, cloud)[:, :2]))
        now = np.unique(np.concatenate(shown))
        known = time_s - self._last_s <= FORGOTTEN_S
        cells = np.union1d(self._cells[known], now)
        first_s, last_s = np.full((2, len(cells)), time_s)
        before = np.searchsorted(cells, self._cells[known])
        first_s[before] = self._first_s[known]
        last_s[before] = np.where(np.isin(self._cells[known], now), time_s, self._last_s[known])
        if len(cells) > MOST_CELLS:
            newest = np.sort(np.argsort(-last_s, kind="stable")[:MOST_CELLS])
            cells, first_s, last_s = cells[newest], first_s[newest], last_s[newest]
        self._cells, self._first_s, self._last_s = cells, first_s, last_s
        self._learnt_s = {
            robot: at for robot, at in self._learnt_s.items() if time_s - at <= FORGOTTEN_S
        }

    def holds(self, boxes: Boxes) -> NDArray[np.bool_]:
        """Of boxes (K) in the world frame: which stand where structure does, bool (K,)."""
        stands = self._cells[self._last_s - self._first_s >= LASTS_S]
        if not len(boxes) or not len(stands):
            return np.zeros(len(boxes), dtype=np.bool_)
        along = CORE * ((np.arange(STEPS) + 0.5) / STEPS - 0.5)
        length, width = (side.ravel() for side in np.meshgrid(along, along))
        forward, left = np.outer(boxes.sizes[:, 0], length), np.outer(boxes.sizes[:, 1], width)
        cos, sin = np.cos(boxes.headings)[:, None], np.sin(boxes.headings)[:, None]
        x = boxes.centers[:, :1] + cos * forward - sin * left
        y = boxes.centers[:, 1:2] + sin * forward + cos * left
        cells = _cells(np.stack([x, y], axis=-1))
        place = np.minimum(np.searchsorted(stands, cells), len(stands) - 1)
        held: NDArray[np.bool_] = (stands[place] == cells).mean(axis=1) >= ENOUGH
        return held

    def judged(self, boxes: Boxes) -> Boxes:
        """Boxes (K) in the world frame whose scores are chances, those in structure less likely."""
        held = self.holds(boxes)
        less = LESS_LIKELY * boxes.scores / (1.0 - (1.0 - LESS_LIKELY) * boxes.scores)
        return replace(boxes, scores=np.where(held, np.minimum(less, boxes.scores), boxes.scores))


def _cells(places: NDArray[np.floating]) -> NDArray[np.int64]:
    """The cells of places (..., 2): int64 (...)."""
    at = np.floor(places / CELL_M).astype(np.int64)
    cells: NDArray[np.int64] = at[..., 0] * _ROW + at[..., 1]
    return cells
